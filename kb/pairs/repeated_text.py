"""Words that transcripts share: videos that say nearly the same, and what a channel repeats.

A word is a run of letters and digits in lower case, so that a manual and an automatic track of one
talk have the same words. Its hash covers its first and last eight bytes and its length.

Duplicates are found by MinHash of runs of five words near keywords: 28 bands of four hashes propose
them, and all 112 hashes decide, as they tell which share of their runs two transcripts have in
common. Of transcripts whose words differ by 4 %, which have two thirds in common, 99 of 100 are
found, at 8 % 80 of 100 (Leskovec, Rajaraman, Ullman: Mining of Massive Datasets, section 3.4). 16
bits are kept of each hash (Li, König: b-Bit Minwise Hashing, 2010), so that a band is one number.

Intros, outros and texts of sponsors recur: a run of six words that at least three videos of the
channel have near a keyword, and one in twenty of them. Runs are counted as 64-bit keys of channel
and words, in pieces of all keys, so that memory is bounded by a piece.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

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

RUN, BANDS, ROWS = 5, 28, 4
ALIKE = 0.33  # share of runs in common from which two transcripts are duplicates
LEAST = 20  # runs of a transcript; shorter ones say too little to be compared
_SEED = 1  # of the hash functions; another one gives other bands
RECURRING_RUN, VIDEOS = 6, 3
ONE_IN = 20  # videos of a channel of which one must have the run
_PIECES = 64


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
        left, other, length = joined * factors
        return int(mixed(np.array([(left ^ other) + length], np.uint64))[0])


def is_among(hashes: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Which hashes are among the known ones, which are sorted and at least one (bool)."""
    bits = np.uint64((1 << max(16, len(known).bit_length() + 3)) - 1)
    likely = np.zeros(int(bits) + 1, bool)  # by the last bits, as a search for each takes longer
    likely[known & bits] = True
    maybe = np.flatnonzero(likely[hashes & bits])
    place = np.minimum(np.searchsorted(known, hashes[maybe]), len(known) - 1)
    among = np.zeros(len(hashes), bool)
    among[maybe] = known[place] == hashes[maybe]
    return among


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


def bands_of(words: HashedWords, videos: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a batch of `videos` transcripts: the numbers of those that are long enough, and their
    bands, uint64 [videos, 28], each four hashes of 16 bits.
    """
    from rensa import RMinHash  # noqa: PLC0415  belongs to the extra `pairs`

    hashes, inside = runs(words, RUN)
    video = words.video[: len(hashes)][inside]
    counts = np.bincount(video, minlength=videos)
    long = np.flatnonzero(counts >= LEAST)
    hashes = hashes[inside][counts[video] >= LEAST]
    offsets = np.concatenate(([0], np.cumsum(counts[long]))).astype(np.uint64)
    if not len(long):
        return long, np.zeros((0, BANDS), np.uint64)
    made = RMinHash.digest_matrix_from_flat_token_hashes(hashes, offsets, BANDS * ROWS, _SEED)
    with np.errstate(over="ignore"):
        # Mixed, because the smallest of many hashes has few bits.
        kept = mixed(np.array(made.to_rows(), np.uint64)).astype("<u2")
    return long, kept.view("<u8")


def firsts(bands: np.ndarray) -> np.ndarray:
    """For each video the number of the first one of its cluster (itself where it is alone).

    `bands` (uint64 [videos, 28]): two videos say nearly the same if they have a band in common and
    a third of all hashes, and so do those that a third video connects.
    """
    first = np.arange(len(bands))
    if len(bands) < 2:
        return first
    edges = []
    hashes = np.ascontiguousarray(bands).astype("<u8").view("<u2")
    for band in bands.T:
        order = np.argsort(band, kind="stable")
        same = np.flatnonzero(band[order][1:] == band[order][:-1])
        low, high = order[same], order[same + 1]
        alike = (hashes[low] == hashes[high]).mean(axis=1) >= ALIKE
        edges.append(np.stack((low[alike], high[alike])))
    return joined_firsts(len(bands), *np.concatenate(edges, axis=1))


def joined_firsts(count: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Of `count` things the number of the first one of the cluster that each is in (itself where it
    is alone), where `low` and `high` are joined one by one.
    """
    first = np.arange(count)
    while True:
        least = np.minimum(first[low], first[high])
        changed = first.copy()
        np.minimum.at(changed, low, least)
        np.minimum.at(changed, high, least)
        changed = changed[changed]
        if (changed == first).all():
            return first
        first = changed


def keys_of(words: HashedWords, channels: Sequence[str | None]) -> np.ndarray:
    """A key for each run of six words of a batch (uint64, one for each word that five others
    follow); 0 for a run that crosses into the next video, or whose video has no channel.

    `channels`: of each video of the batch.
    """
    hashes, inside = runs(words, RECURRING_RUN)
    salts = [
        int.from_bytes(hashlib.sha256(channel.encode()).digest()[:8], "little") | 1
        if channel is not None
        else 0
        for channel in channels
    ]
    salt = np.array(salts, np.uint64)[words.video[: len(hashes)]]
    return np.where(inside & (salt != 0), mixed(hashes ^ salt), np.uint64(0))


def once_a_video(keys: np.ndarray, video: np.ndarray) -> np.ndarray:
    """The keys of a batch, each once for each video that has it, in no order that matters.
    `video`: of each key, ascending.
    """
    keys = keys.copy()
    bounds = np.flatnonzero(np.diff(video, prepend=-1, append=-1)).tolist()
    for low, high in pairwise(bounds):
        keys[low:high].sort()
    new = np.ones(len(keys), bool)
    new[1:] = (keys[1:] != keys[:-1]) | (video[1:] != video[:-1])
    return keys[new & (keys != 0)]


def recurring(files: Sequence[Path]) -> tuple[np.ndarray, np.ndarray]:
    """Of runs that at least three videos of a channel have: their sorted keys (uint64), and how
    many videos have each. `files`: sorted arrays of keys (.npy), each key once for each video of
    the file that has it.
    """
    arrays = [np.load(path, mmap_mode="r") for path in files]
    bounds = np.arange(_PIECES + 1, dtype=np.float64) * 2.0**64 / _PIECES
    limits = [np.searchsorted(array, bounds[1:-1].astype(np.uint64)) for array in arrays]
    recurs = [np.zeros(0, np.uint64)]
    counts = [np.zeros(0, np.int64)]
    for piece in range(_PIECES):
        parts = [np.zeros(0, np.uint64)]
        for array, at in zip(arrays, limits, strict=True):
            low = at[piece - 1] if piece else 0
            high = at[piece] if piece < _PIECES - 1 else len(array)
            parts.append(array[low:high])
        keys = np.concatenate(parts)
        keys.sort(kind="stable")  # merges what is sorted already
        starts = np.flatnonzero(np.diff(keys, prepend=np.uint64(0)) != 0)  # no key is 0
        videos = np.diff(starts, append=len(keys))
        often = videos >= VIDEOS
        recurs.append(keys[starts[often]])
        counts.append(videos[often])
    return np.concatenate(recurs), np.concatenate(counts)


def around(keys: np.ndarray, first: np.ndarray, after: np.ndarray) -> pa.Array[Any]:
    """The keys of the runs that reach into each text, a list of `words + 5` each (0 where there is
    none). `first`, `after`: the first word of each text and the one after its last.
    """
    sizes = after - first + RECURRING_RUN - 1
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    place = np.arange(offsets[-1]) + np.repeat(first - (RECURRING_RUN - 1) - offsets[:-1], sizes)
    there = (place >= 0) & (place < len(keys))
    values = np.zeros(len(place), np.uint64)
    values[there] = keys[place[there]]
    made = pa.LargeListArray.from_arrays(pa.array(offsets, pa.int64()), pa.array(values))
    return cast("pa.Array[Any]", made)


def shares(
    keys: pa.Array[Any], recurs: tuple[np.ndarray, np.ndarray], videos: np.ndarray
) -> np.ndarray:
    """The share of each text's words that lie in a recurring run (0 to 1; 0 for no words).

    `keys`: lists as `around` makes them; `videos`: how many the channel of each text has.
    """
    values = np.asarray(pc.list_flatten(keys))
    sizes = np.asarray(pc.list_value_length(keys))
    known, having = recurs
    if not len(known) or not len(values):
        return np.zeros(len(sizes))
    text = np.repeat(np.arange(len(sizes)), sizes)
    hits = np.flatnonzero(is_among(values, known))
    having = having[np.searchsorted(known, values[hits])]
    recur = np.zeros(len(values), bool)
    recur[hits[having * ONE_IN >= videos[text[hits]]]] = True
    total = np.concatenate(([0], np.cumsum(recur), np.full(RECURRING_RUN, -1)))
    total[total < 0] = total[len(values)]
    in_run = total[RECURRING_RUN : RECURRING_RUN + len(values)] > total[: len(values)]
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    words = np.maximum(sizes - RECURRING_RUN + 1, 0)
    own = np.arange(len(values)) - offsets[text] < words[text]
    shared = np.bincount(text[own & in_run], minlength=len(sizes))
    return shared / np.maximum(words, 1)
