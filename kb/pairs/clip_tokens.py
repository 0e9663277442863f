"""CLIP tokens of words. A text's tokens are those of its words, as CLIP's pattern never crosses
white space.

Source: Radford et al., "Learning Transferable Visual Models From Natural Language Supervision"
(2021); the vocabulary ships with instant-clip-tokenizer.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING

import pyarrow as pa

from kb.core.installation import np

if TYPE_CHECKING:
    from instant_clip_tokenizer import Tokenizer

ENDS = 2  # start and end token, counted in every text
LENGTH = 77  # tokens that CLIP reads
_START, _END = 49_406, 49_407
_MOST_KNOWN = 1_000_000  # words remembered; the least recent ones beyond are counted again


class Tokens:
    """Counts tokens and remembers the count of every word."""

    def __init__(self) -> None:
        self._encode = _tokenizer().encode
        self._count_word = lru_cache(_MOST_KNOWN)(
            lambda word: self.count(word.decode("utf-8", "replace"))
        )

    def count(self, text: str) -> int:
        """Tokens of a text without the two ends."""
        return len(self._encode(text))

    def of_words(self, codes: np.ndarray, words: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Tokens of each wanted word, 0 of the others.

        `codes` are the text's bytes, `words` where each word begins (the last one ends with the
        bytes), `wanted` a mask over words.
        """
        offsets = np.append(words, len(codes)).astype(np.int64)
        every = pa.Array.from_buffers(
            pa.large_binary(),
            len(words),
            [None, pa.py_buffer(offsets.data), pa.py_buffer(codes.data)],
        )
        chosen = every.filter(pa.array(wanted)).dictionary_encode()
        different = np.fromiter(map(self._count_word, chosen.dictionary.to_pylist()), np.int32)
        counts = np.zeros(len(words), np.int32)
        if len(different):
            counts[wanted] = different[np.asarray(chosen.indices)]
        return counts


def token_ids(text: str) -> np.ndarray:
    """CLIP's ids of a text: int64 [77], start and end among them, padded with 0."""
    words = _tokenizer().encode(text)[: LENGTH - ENDS]
    ids = np.zeros(LENGTH, np.int64)
    ids[: len(words) + ENDS] = [_START, *words, _END]
    return ids


@cache
def _tokenizer() -> Tokenizer:
    """One for all: reading the vocabulary takes longer than a small text."""
    from instant_clip_tokenizer import Tokenizer

    return Tokenizer()
