"""Which matches count, the clip of each, and which clips are kept."""

from __future__ import annotations

import bisect

from kb.core.optional import np


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
