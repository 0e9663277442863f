"""Words of a batch of transcripts as 64-bit numbers, and runs of them.

A word is a run of letters and digits in lower case, so that a manual and an automatic track of one
talk have the same words. Its hash covers its first and last eight bytes and its length.
"""

from __future__ import annotations

from typing import NamedTuple

from kb.core.installation import np
from kb.pairs.extract import Matches
from kb.pairs.matching import ASCII
from kb.pairs.seeded_random import mixed
from kb.pairs.transcript_batch import Text

AROUND = 80  # words on each side of a match; the text of a pair reaches no further
_FIRST, _LAST, _LENGTH, _STEP = (
    0x9E3779B97F4A7C15,
    0xC2B2AE3D27D4EB4F,
    0x165667B19E3779F9,
    0xD6E8FEB86659FD93,
)


class HashedWords(NamedTuple):
    """Words in order: first byte in the batch (int64), hash (uint64), number of the video, number
    of the stretch of text that was hashed.
    """

    at: np.ndarray
    hash: np.ndarray
    video: np.ndarray
    stretch: np.ndarray

    def between(self, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first word from each byte `start` on, and the first one from `end` on."""
        return np.searchsorted(self.at, start), np.searchsorted(self.at, end)


def hashed_words(text: Text, matches: Matches | None = None) -> HashedWords:
    """The words of a batch; with `matches` only those at most 80 words from one, as most of a
    transcript is far from every keyword and in the text of no pair.
    """
    if matches is None:
        begin, end = text.video_at, text.video_end
    else:
        begin, end = _stretches(text, matches)
    sizes = end - begin
    pieces = [text.raw[low:high] for low, high in zip(begin.tolist(), end.tolist(), strict=True)]
    data = bytes(8) + b" ".join(pieces).translate(ASCII) + bytes(8)
    codes = np.frombuffer(data, np.uint8)
    space = (codes == 0x20) | (codes == 0)
    edges = np.flatnonzero(space[1:] != space[:-1]) + 1
    starts, ends = edges[::2], edges[1::2]
    eight = np.ndarray((len(data) - 7,), "<u8", data, strides=(1,))
    length = ends - starts
    beyond = (8 * np.maximum(8 - length, 0)).astype(np.uint64)
    first = (eight[starts] << beyond) >> beyond
    last = eight[ends - 8] >> beyond
    with np.errstate(over="ignore"):
        joined = first * np.uint64(_FIRST) ^ last * np.uint64(_LAST)
        hashes = mixed(joined + length.astype(np.uint64) * np.uint64(_LENGTH))
    place = 8 + np.concatenate(([0], np.cumsum(sizes + 1)))[:-1]
    counts = np.diff(np.searchsorted(starts, place), append=len(starts))
    stretch = np.repeat(np.arange(len(begin)), counts)
    at = starts + (begin - place)[stretch]
    return HashedWords(at, hashes, text.video_of(begin)[stretch], stretch)


def _stretches(text: Text, matches: Matches) -> tuple[np.ndarray, np.ndarray]:
    """First byte of each stretch of text around matches, and the byte after its last."""
    words = np.append(text.words, len(text.raw))
    low = np.searchsorted(words, text.video_at[matches.video])
    high = np.searchsorted(words, text.video_end[matches.video])
    begin = words[np.maximum(matches.first - AROUND, low)]
    after = np.minimum(matches.last + 1 + AROUND, high)
    end = np.minimum(words[after], text.video_end[matches.video])
    reach = np.maximum.accumulate(end) if len(end) else end
    new = np.ones(len(begin), bool)
    new[1:] = begin[1:] >= reach[:-1]
    heads = np.flatnonzero(new)
    return begin[heads], reach[np.append(heads[1:], len(reach)) - 1] if len(heads) else reach


def hash_of(word: str) -> int:
    """The hash of a word in lower case, without spaces."""
    data = word.encode()
    size = min(len(data), 8)
    first, last = (int.from_bytes(part, "little") for part in (data[:8], data[-size:]))
    joined = np.array([first, last, len(data)], np.uint64)
    with np.errstate(over="ignore"):
        factors = np.array([_FIRST, _LAST, _LENGTH], np.uint64)
        one, other, length = joined * factors
        return int(mixed(np.array([(one ^ other) + length], np.uint64))[0])


def is_among(hashes: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Which hashes are among the known ones, which are sorted and at least one (bool)."""
    bits = np.uint64((1 << max(16, len(known).bit_length() + 3)) - 1)
    likely = np.zeros(int(bits) + 1, bool)  # by the last bits, as a search for each takes longer
    likely[known & bits] = True
    maybe = np.flatnonzero(likely[hashes & bits])
    place = np.minimum(np.searchsorted(known, hashes[maybe]), len(known) - 1)
    found = np.zeros(len(hashes), bool)
    found[maybe] = known[place] == hashes[maybe]
    return found


def runs(words: HashedWords, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A hash of each run of `size` words, and whether the run stays in one stretch. There is a run
    for each word that at least `size` - 1 others follow in the batch.
    """
    count = max(len(words.hash) - size + 1, 0)
    total = np.zeros(count, np.uint64)
    with np.errstate(over="ignore"):
        for place in range(size):
            total = total * np.uint64(_STEP) + words.hash[place : place + count]
    inside: np.ndarray = words.stretch[:count] == words.stretch[size - 1 : size - 1 + count]
    return mixed(total), inside
