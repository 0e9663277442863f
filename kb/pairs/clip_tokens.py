"""CLIP tokens of words. A text's tokens are those of its words, as CLIP's pattern never crosses
white space.

Source: Radford et al., "Learning Transferable Visual Models From Natural Language Supervision"
(2021). The vocabulary is the file of https://github.com/openai/CLIP (clip_vocabulary/, MIT).

The text around a match, grown word by word on both sides to a drawn number of CLIP tokens.

A share of the tokens that are left is drawn for the left side; the right side takes the rest, and
each gives the other what its end of the transcript can't use. A text has at least `low` tokens
where its transcript has them and never more than `high`: it ends inside a word only where a word
alone is longer than that (text without spaces, addresses).
"""

from __future__ import annotations

import gzip
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pyarrow as pa

from kb.core.installation import np
from kb.pairs.transcript_batch import Text

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
    # A visible character for each byte, in the order of CLIP's ids: bytes that are one in Latin-1
    # stand for themselves, and come first.
    visible = [*range(0x21, 0x7F), *range(0xA1, 0xAD), *range(0xAE, 0x100)]
    letters = [*map(chr, visible), *(chr(0x100 + number) for number in range(256 - len(visible)))]
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


class Grown(NamedTuple):
    """Texts: first byte, byte after the last (white space may be before it),
    tokens with both ends, first bytes of the first and the last word.
    """

    start: np.ndarray
    end: np.ndarray
    tokens: np.ndarray
    first: np.ndarray
    last: np.ndarray


def grow(
    text: Text,
    counter: Tokens,
    places: tuple[np.ndarray, np.ndarray],
    video: np.ndarray,
    *,
    goal: np.ndarray,
    side: np.ndarray,
    low: int,
    high: int,
) -> Grown:
    """`places`: first byte of the phrase and the one after it; `goal`: tokens drawn; `side`: tokens
    out of `goal` for the left, at most."""
    start, end = places
    words = np.append(text.words, len(text.codes))
    begin = np.searchsorted(words, text.video_at[video])
    stop = np.searchsorted(words, text.video_end[video])
    first = np.searchsorted(words, start, "right") - 1
    after = np.searchsorted(words, end - 1, "right")
    least, most = np.maximum(begin, first - high), np.minimum(stop, after + high)
    edges = np.bincount(least, minlength=len(words) + 1)
    edges -= np.bincount(most, minlength=len(words) + 1)
    reached = np.cumsum(edges)[:-1] > 0
    counts = counter.of_words(text.codes, words, reached)
    total = np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))
    goal = goal - ENDS
    own = total[after] - total[first]
    a = np.maximum(
        np.searchsorted(total, total[first] - np.minimum(side, np.maximum(goal - own, 0)), "left"),
        least,
    )
    a = np.minimum(a, first)
    b = np.clip(np.searchsorted(total, total[a] + goal, "left"), after, most)
    b -= (total[b] - total[a] > high - ENDS) & (b > after)
    short = total[b] - total[a] < goal  # the right side has ended: more from the left
    further = np.clip(np.searchsorted(total, total[b] - goal, "right") - 1, least, a)
    further += (total[b] - total[further] > high - ENDS) & (further < a)
    a = np.where(short, further, a)
    tokens = total[b] - total[a] + ENDS
    grown = Grown(words[a], words[b], tokens, words[a], words[b - 1])
    hard = (tokens > high) | ((tokens < low) & ((a > begin) | (b < stop)))
    for pair in np.flatnonzero(hard).tolist():
        begins = (
            (int(start[pair]), int(end[pair]))
            if tokens[pair] > high
            else (int(grown.start[pair]), int(grown.end[pair]))
        )
        bounds = (int(text.video_at[video[pair]]), int(text.video_end[video[pair]]))
        grown.start[pair], grown.end[pair], grown.tokens[pair] = _cut(
            text, counter, begins, bounds, goal=max(low, int(goal[pair]) + ENDS), high=high
        )
        grown.first[pair] = text.words[np.searchsorted(text.words, grown.start[pair], "right") - 1]
        grown.last[pair] = text.words[np.searchsorted(text.words, grown.end[pair]) - 1]
    return grown


def _cut(
    text: Text,
    counter: Tokens,
    begins: tuple[int, int],
    bounds: tuple[int, int],
    *,
    goal: int,
    high: int,
) -> tuple[int, int, int]:
    """The rare text beside words too long to take whole: grown on, character by character,
    right and then left.
    """
    start, end = begins
    low, top = bounds

    def size(begin: int, finish: int) -> int:
        return counter.count(text.codes[begin:finish].tobytes().decode("utf-8", "replace")) + ENDS

    def inside(place: int) -> bool:
        return low < place < top and bool(text.codes[place] & 0xC0 == 0x80)

    tokens = size(start, end)
    while tokens < goal and end < top:
        place = end + 1
        while inside(place):
            place += 1
        more = size(start, place)
        if more > high:
            break
        end, tokens = place, more
    while tokens < goal and start > low:
        place = start - 1
        while inside(place):
            place -= 1
        more = size(place, end)
        if more > high:
            break
        start, tokens = place, more
    while text.codes[start] == 0x20:
        start += 1
    return start, end, tokens
