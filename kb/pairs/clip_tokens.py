"""CLIP tokens of words. A text's tokens are those of its words, as CLIP's pattern never crosses
white space.

Source: Radford et al., "Learning Transferable Visual Models From Natural Language Supervision"
(2021). The vocabulary is the file of https://github.com/openai/CLIP (clip_vocabulary/, MIT).
"""

from __future__ import annotations

import gzip
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from kb.core.installation import np

if TYPE_CHECKING:
    from tokenizers import Encoding, Tokenizer

ENDS = 2  # start and end token, counted in every text
LENGTH = 77  # tokens that CLIP reads
_START, _END = 49_406, 49_407
_MERGES = 48_894  # what CLIP takes of the file: 49,152 ids less two for each byte, and two more
_VOCABULARY = Path(__file__).with_name("clip_vocabulary") / "bpe_simple_vocab_16e6.txt.gz"
# Runs of letters, single digits, runs of other signs; English contractions apart.
_WORD = r"'s|'t|'re|'ve|'m|'ll|'d|\p{L}+|\p{N}|[^\s\p{L}\p{N}]+"
_MOST_KNOWN = 1_000_000  # words remembered; the least recent ones beyond are counted again


class Tokens:
    """Counts tokens and remembers the count of every word."""

    def __init__(self) -> None:
        self._count_word = lru_cache(_MOST_KNOWN)(
            lambda word: self.count(word.decode("utf-8", "replace"))
        )

    def count(self, text: str) -> int:
        """Tokens of a text without the two ends."""
        return len(_encode(text))

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
    words = _encode(text).ids[: LENGTH - ENDS]
    ids = np.zeros(LENGTH, np.int64)
    ids[: len(words) + ENDS] = [_START, *words, _END]
    return ids


def _encode(text: str) -> Encoding:
    # A sigma at the end of a word has a small letter of its own, which depends on its neighbours;
    # the tokenizer lowers each letter alone.
    if "Σ" in text:
        text = text.lower()
    return _tokenizer().encode(text, add_special_tokens=False)


@cache
def _tokenizer() -> Tokenizer:
    """One for all: reading the vocabulary takes longer than a small text."""
    from tokenizers import Regex, Tokenizer, models, normalizers, pre_tokenizers

    with gzip.open(_VOCABULARY, "rt", encoding="utf-8") as file:
        merges = [(a, b) for a, b in map(str.split, islice(file, 1, _MERGES + 1))]
    letters = _letters()
    tokens = [*letters, *(f"{letter}</w>" for letter in letters)]
    tokens += [a + b for a, b in merges]
    ids = {token: number for number, token in enumerate(tokens)}
    tokenizer = Tokenizer(models.BPE(ids, merges, end_of_word_suffix="</w>"))
    tokenizer.normalizer = normalizers.Lowercase()
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Split(Regex(_WORD), "removed", invert=True),
            pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
        ]
    )
    return tokenizer


def _letters() -> list[str]:
    """A visible character for each byte, in the order of CLIP's ids: bytes that are one in Latin-1
    stand for themselves, and come first.
    """
    visible = [*range(0x21, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x100)]
    return [*map(chr, visible), *(chr(0x100 + number) for number in range(256 - len(visible)))]
