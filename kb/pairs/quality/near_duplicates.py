"""Videos that say nearly the same around keywords, by MinHash of runs of five words.

Fourteen bands of eight hashes, as datatrove has them: of two transcripts with four fifths of their
runs in common 92 of 100 are found, with nine tenths all, with a half 5 of 100 (Leskovec, Rajaraman,
Ullman: Mining of Massive Datasets, section 3.4).
"""

from __future__ import annotations

from typing import NamedTuple

from kb.core.installation import np
from kb.pairs.quality.hashed_words import HashedWords, runs
from kb.pairs.seeded_random import mixed

RUN, BANDS, ROWS = 5, 14, 8
LEAST = 20  # runs of a transcript; shorter ones say too little to be compared
_SEED = 1  # of the hash functions; another one gives other bands


class VideoBands(NamedTuple):
    """`video`: numbers of the videos that are long enough; `bands`: uint64 [videos, 14]."""

    video: np.ndarray
    bands: np.ndarray


def bands_of(words: HashedWords, videos: int) -> VideoBands:
    """The bands of a batch of `videos` transcripts."""
    from rensa import RMinHash  # noqa: PLC0415  belongs to the extra `pairs`

    hashes, inside = runs(words, RUN)
    video = words.video[: len(hashes)][inside]
    counts = np.bincount(video, minlength=videos)
    long = np.flatnonzero(counts >= LEAST)
    hashes = hashes[inside][counts[video] >= LEAST]
    offsets = np.concatenate(([0], np.cumsum(counts[long]))).astype(np.uint64)
    if not len(long):
        return VideoBands(long, np.zeros((0, BANDS), np.uint64))
    made = RMinHash.digest_matrix_from_flat_token_hashes(hashes, offsets, BANDS * ROWS, _SEED)
    rows = np.array(made.to_rows(), np.uint64).reshape(len(long), BANDS, ROWS)
    total = np.broadcast_to(np.arange(BANDS, dtype=np.uint64), (len(long), BANDS)).copy()
    with np.errstate(over="ignore"):
        for place in range(ROWS):
            total = mixed(total) + rows[:, :, place]
    return VideoBands(long, mixed(total))


def firsts(bands: np.ndarray) -> np.ndarray:
    """For each video the number of the first one of its cluster (itself where it is alone).

    `bands` (uint64 [videos, 14]): two videos with the same value in a band say nearly the same,
    and so do those that a third one connects.
    """
    first = np.arange(len(bands))
    if len(bands) < 2:
        return first
    edges = []
    for band in bands.T:
        order = np.argsort(band, kind="stable")
        same = np.flatnonzero(band[order][1:] == band[order][:-1])
        edges.append(np.stack((order[same], order[same + 1])))
    low, high = np.concatenate(edges, axis=1)
    while True:
        least = np.minimum(first[low], first[high])
        changed = first.copy()
        np.minimum.at(changed, low, least)
        np.minimum.at(changed, high, least)
        changed = changed[changed]
        if (changed == first).all():
            return first
        first = changed
