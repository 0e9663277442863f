"""CLIP tokens of words. A text's tokens are those of its words, as CLIP's pattern never crosses
white space.

Source: Radford et al., "Learning Transferable Visual Models From Natural Language Supervision"
(2021); the vocabulary ships with instant-clip-tokenizer.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import pyarrow as pa

from kb.core.optional import np

if TYPE_CHECKING:
    from instant_clip_tokenizer import Tokenizer

ENDS = 2  # start and end token, counted in every text
_MOST_KNOWN = 1_000_000  # words remembered; rare ones beyond are counted anew


class Tokens:
    """Counts tokens and remembers the count of every word."""

    def __init__(self) -> None:
        self._encode = _tokenizer().encode
        self._known: dict[bytes, int] = {}

    def count(self, text: str) -> int:
        """Tokens of a text without the two ends."""
        return len(self._encode(text))

    def of_words(self, codes: np.ndarray, words: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Tokens of each wanted word, 0 of the others.

        `codes` are the text's bytes, `words` where each word begins (the last one ends with the
        bytes), `wanted` a mask over words.
        """
        offsets = np.append(words, len(codes))
        kind, width = (
            (pa.binary(), np.int32) if len(codes) < 2**31 else (pa.large_binary(), np.int64)
        )
        every = pa.Array.from_buffers(
            kind,
            len(words),
            [None, pa.py_buffer(offsets.astype(width).data), pa.py_buffer(codes.data)],
        )
        chosen = every.filter(pa.array(wanted)).dictionary_encode()
        different = np.asarray(self._counts(_values(chosen.dictionary)), np.int32)
        counts = np.zeros(len(words), np.int32)
        if len(different):
            counts[wanted] = different[np.asarray(chosen.indices)]
        return counts

    def _counts(self, words: list[bytes]) -> list[int]:
        """Tokens of different words."""
        counts = list(map(self._known.get, words))
        for place in [place for place, count in enumerate(counts) if count is None]:
            counts[place] = count = self.count(words[place].decode("utf-8", "replace"))
            if len(self._known) < _MOST_KNOWN:
                self._known[words[place]] = count
        return cast("list[int]", counts)


@cache
def _tokenizer() -> Tokenizer:
    """One for all: reading the vocabulary takes longer than a small text."""
    from instant_clip_tokenizer import Tokenizer

    return Tokenizer()


def _values(words: pa.Array[Any]) -> list[bytes]:
    """The values of a binary array, without an object for each that Arrow's own way makes."""
    _, offsets, data = words.buffers()
    width: type[np.signedinteger[Any]] = np.int32 if words.type == pa.binary() else np.int64
    places = np.frombuffer(memoryview(offsets or b""), width).tolist()
    places = places[words.offset : words.offset + len(words) + 1]
    held = data.to_pybytes() if data is not None else b""
    return [held[begin:end] for begin, end in pairwise(places)]
