"""What a channel says again and again: intros, outros, texts of sponsors.

A run of eight words recurs when at least three videos of the channel have it near a keyword. Runs
are counted as 64-bit keys of channel and words, in pieces of all keys, so that memory is bounded by
a piece.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.installation import np
from kb.pairs.quality.hashed_words import HashedWords, is_among, runs
from kb.pairs.seeded_random import mixed

RUN, VIDEOS = 8, 3
_PIECES = 64


def keys_of(words: HashedWords, channels: Sequence[str | None]) -> np.ndarray:
    """A key for each run of eight words of a batch (uint64, one for each word that seven others
    follow); 0 for a run that crosses into the next video, or whose video has no channel.

    `channels`: of each video of the batch.
    """
    hashes, inside = runs(words, RUN)
    salts = np.array([_salt(channel) for channel in channels], np.uint64)
    salt = salts[words.video[: len(hashes)]]
    return np.where(inside & (salt != 0), mixed(hashes ^ salt), np.uint64(0))


def _salt(channel: str | None) -> int:
    if channel is None:
        return 0
    return int.from_bytes(hashlib.sha256(channel.encode()).digest()[:8], "little") | 1


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


def recurring(files: Sequence[Path]) -> np.ndarray:
    """The keys that at least three videos have, sorted. `files`: sorted arrays of keys (.npy), each
    key once for each video of the file that has it.
    """
    arrays = [np.load(path, mmap_mode="r") for path in files]
    bounds = np.arange(_PIECES + 1, dtype=np.float64) * 2.0**64 / _PIECES
    limits = [np.searchsorted(one, bounds[1:-1].astype(np.uint64)) for one in arrays]
    found = []
    for piece in range(_PIECES):
        parts = []
        for one, at in zip(arrays, limits, strict=True):
            low = at[piece - 1] if piece else 0
            high = at[piece] if piece < _PIECES - 1 else len(one)
            parts.append(one[low:high])
        keys = np.concatenate(parts) if parts else np.zeros(0, np.uint64)
        keys.sort(kind="stable")  # merges what is sorted already
        # In sorted keys one that stands two places further on is there three times.
        again = keys[: len(keys) - VIDEOS + 1][keys[: len(keys) - VIDEOS + 1] == keys[VIDEOS - 1 :]]
        found.append(again[np.diff(again, prepend=np.uint64(0)) != 0])  # no key is 0
    return np.concatenate(found)


def around(keys: np.ndarray, first: np.ndarray, after: np.ndarray) -> pa.Array[Any]:
    """The keys of the runs that reach into each text, a list of `words + 7` each (0 where there is
    none). `first`, `after`: the first word of each text and the one after its last.
    """
    sizes = after - first + RUN - 1
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    place = np.arange(offsets[-1]) + np.repeat(first - (RUN - 1) - offsets[:-1], sizes)
    there = (place >= 0) & (place < len(keys))
    values = np.zeros(len(place), np.uint64)
    values[there] = keys[place[there]]
    made = pa.LargeListArray.from_arrays(pa.array(offsets, pa.int64()), pa.array(values))
    return cast("pa.Array[Any]", made)


def shares(keys: pa.Array[Any], recurs: np.ndarray) -> np.ndarray:
    """The share of each text's words that lie in a recurring run (0 to 1; 0 for no words).

    `keys`: lists as `around` makes them; `recurs`: as `recurring` does.
    """
    values = np.asarray(pc.list_flatten(keys))
    sizes = np.asarray(pc.list_value_length(keys))
    if not len(recurs) or not len(values):
        return np.zeros(len(sizes))
    total = np.concatenate(([0], np.cumsum(is_among(values, recurs)), np.full(RUN, -1)))
    total[total < 0] = total[len(values)]
    in_run = total[RUN : RUN + len(values)] > total[: len(values)]
    offsets = np.concatenate(([0], np.cumsum(sizes)))
    words = np.maximum(sizes - RUN + 1, 0)
    text = np.repeat(np.arange(len(sizes)), sizes)
    own = np.arange(len(values)) - offsets[text] < words[text]
    hits = np.bincount(text[own & in_run], minlength=len(sizes))
    return hits / np.maximum(words, 1)
