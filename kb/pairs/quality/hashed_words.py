"""Words of a batch of transcripts as 64-bit numbers, and runs of them.

A word is a run of letters and digits in lower case, so that a manual and an automatic track of one
talk have the same words. Its hash covers its first and last eight bytes and its length.
"""

from __future__ import annotations

from typing import NamedTuple

from kb.core.installation import np
from kb.pairs.matching import ASCII, WALL
from kb.pairs.seeded_random import mixed
from kb.pairs.transcript_batch import Text

_FIRST, _LAST, _LENGTH, _STEP = (
    0x9E3779B97F4A7C15,
    0xC2B2AE3D27D4EB4F,
    0x165667B19E3779F9,
    0xD6E8FEB86659FD93,
)


class HashedWords(NamedTuple):
    """Words in order: first byte in the batch (int64), hash (uint64), number of the video."""

    at: np.ndarray
    hash: np.ndarray
    video: np.ndarray

    def between(self, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first word from each byte `start` on, and the first one from `end` on."""
        return np.searchsorted(self.at, start), np.searchsorted(self.at, end)


def hashed_words(text: Text) -> HashedWords:
    """The words of a batch."""
    data = bytes(8) + text.raw.translate(ASCII) + bytes(8)
    codes = np.frombuffer(data, np.uint8)
    space = (codes == 0x20) | (codes == 0) | (codes == WALL)
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
    at = starts - 8
    counts = np.diff(np.searchsorted(at, text.video_at), append=len(at))
    return HashedWords(at, hashes, np.repeat(np.arange(len(text)), counts))


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


def runs(words: HashedWords, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A hash of each run of `size` words, and whether the run stays in one video. There is a run
    for each word that at least `size` - 1 others follow in the batch.
    """
    count = max(len(words.hash) - size + 1, 0)
    total = np.zeros(count, np.uint64)
    with np.errstate(over="ignore"):
        for place in range(size):
            total = total * np.uint64(_STEP) + words.hash[place : place + count]
    inside: np.ndarray = words.video[:count] == words.video[size - 1 : size - 1 + count]
    return mixed(total), inside
