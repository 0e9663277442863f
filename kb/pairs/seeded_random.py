"""Random numbers that depend on (seed, video id, position of the match, purpose) and nothing else.

SplitMix64 (Steele, Lea, Flood: "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014) over
a key a video, so that whole arrays are drawn at once and no order of work can change a number.
"""

from __future__ import annotations

import bisect
import hashlib
from collections.abc import Iterable
from typing import Any

import pyarrow as pa

from kb.core.installation import np

PURPOSES = {
    name: number
    for number, name in enumerate(("rank", "tokens", "side", "center", "clip", "id"), start=1)
}
_GOLDEN = 0x9E3779B97F4A7C15


def video_keys(seed: int, ids: Iterable[str]) -> np.ndarray:
    """64 bits for each video."""
    start = hashlib.sha256(f"{seed}\x1f".encode())
    keys = []
    for id_ in ids:
        digest = start.copy()
        digest.update(id_.encode())
        keys.append(digest.digest()[:8])
    return np.frombuffer(b"".join(keys), "<u8")


def bits(keys: np.ndarray, positions: np.ndarray, purpose: str) -> np.ndarray:
    """64 bits for each match: `keys` of its video, `positions` in its transcript."""
    with np.errstate(over="ignore"):
        start = mixed(keys + np.uint64(PURPOSES[purpose]) * np.uint64(0xD1342543DE82EF95))
        return mixed(start + (positions.astype(np.uint64) + np.uint64(1)) * np.uint64(_GOLDEN))


def integers(drawn: np.ndarray, low: np.ndarray | int, high: np.ndarray | int) -> np.ndarray:
    """Bits as integers from `low` to `high`, both included."""
    share = (drawn >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return low + np.floor(share * (np.maximum(high, low) - low + 1)).astype(np.int64)


def hexadecimal(drawn: np.ndarray) -> pa.Array[Any]:
    """Bits as sixteen hexadecimal digits."""
    digits = np.frombuffer(b"0123456789abcdef", np.uint8)
    codes = drawn.astype(">u8").view(np.uint8)
    text = np.stack((digits[codes >> 4], digits[codes & 15]), axis=1).tobytes()
    offsets = np.arange(0, 16 * len(drawn) + 1, 16, dtype=np.int32)
    return pa.StringArray.from_buffers(len(drawn), pa.py_buffer(offsets.data), pa.py_buffer(text))


def mixed(value: np.ndarray) -> np.ndarray:
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


def supported(
    first: np.ndarray, last: np.ndarray, video: np.ndarray, certain: np.ndarray, reach: np.ndarray
) -> np.ndarray:
    """Which matches stand near a certain one: at most `reach` words from it, in the same video.

    `first` and `last` are the words of each match, in order; certain matches support themselves.
    """
    sure = np.flatnonzero(certain)
    near = certain.copy()
    asking = np.flatnonzero(~certain)
    if not len(sure) or not len(asking):
        return near
    place = np.searchsorted(first[sure], first[asking])
    before, behind = sure[np.maximum(place - 1, 0)], sure[np.minimum(place, len(sure) - 1)]
    ok = (
        (place > 0)
        & (video[before] == video[asking])
        & (first[asking] - last[before] <= reach[asking])
    )
    ok |= (
        (place < len(sure))
        & (video[behind] == video[asking])
        & (first[behind] - last[asking] <= reach[asking])
    )
    near[asking] = ok
    return near


def around(
    center: np.ndarray, length: np.ndarray, phrase: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Centres (ms) moved no further than needed for clips of these lengths to contain phrases, of
    which those that are longer than their clip are left out.
    """
    before = length // 2
    moved = np.clip(center, phrase[1] - (length - before), phrase[0] + before)
    return np.where(phrase[1] - phrase[0] <= length, moved, center)


def clips(
    center: np.ndarray, length: np.ndarray, video_length: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Start and end (ms) of clips around centres, moved inside the video;
    as long as the video at most.
    """
    length = np.minimum(length, video_length)
    start = np.clip(center - length // 2, 0, video_length - length)
    return start, start + length


def choose(
    start: np.ndarray, end: np.ndarray, video: np.ndarray, rank: np.ndarray, gap: int, most: int
) -> np.ndarray:
    """A mask of clips: in the order of their rank within each video, each one that keeps `gap` ms
    from all clips taken before it, `most` a video at most (0: all).
    """
    taken = np.zeros(len(start), bool)
    kept: dict[int, list[tuple[int, int]]] = {}  # the clips taken of each video, by start
    begins, ends, videos = start.tolist(), end.tolist(), video.tolist()
    for clip in np.argsort(rank, kind="stable").tolist():
        begin, finish, others = begins[clip], ends[clip], kept.setdefault(videos[clip], [])
        place = bisect.bisect(others, (begin, finish))
        # Unless clips may overlap, only the two neighbours can be too close.
        near = others if gap < 0 else others[max(place - 1, 0) : place + 1]
        if (most and len(others) == most) or any(
            begin < other_end + gap and other < finish + gap for other, other_end in near
        ):
            continue
        others.insert(place, (begin, finish))
        taken[clip] = True
    return taken
