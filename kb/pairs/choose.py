"""Which matches count, the clip of each, and which clips are kept."""

from __future__ import annotations

import bisect

from kb.core.optional import np

_CROWDED = (
    200  # clips within reach of one, from where listing all pairs of neighbours is no longer cheap
)


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


def apart(
    start: np.ndarray, end: np.ndarray, video: np.ndarray, rank: np.ndarray, gap: int, most: int
) -> np.ndarray:
    """A mask of clips: by rank within each video, each that keeps `gap` ms from all taken before
    it, `most` at most (0: all).

    The same as taking clips one by one in the order of their rank: a clip that has the best rank of
    all undecided ones that it overlaps is taken, those are dropped, and so on.
    """
    size = len(start)
    place = np.empty(size, np.int64)
    place[np.lexsort((np.arange(size), rank))] = np.arange(size)  # ranks without ties
    overlaps = _overlaps(start, end, video, gap)
    taken, open_ = np.zeros(size, bool), np.ones(size, bool)
    if overlaps is None:
        taken, open_ = _one_by_one(start, end, video, place, gap), taken
        overlaps = np.empty(0, np.int64), np.empty(0, np.int64)
    one, other = overlaps
    while open_.any():
        best = open_.copy()
        best[np.where(place[one] > place[other], one, other)] = False
        taken |= best
        open_ &= ~best
        open_[one[best[other]]] = False
        open_[other[best[one]]] = False
        alive = open_[one] & open_[other]
        one, other = one[alive], other[alive]
    if most:
        order = np.lexsort((place, ~taken, video))
        ordered = video[order]
        nth = np.arange(size) - np.searchsorted(ordered, ordered, "left")
        taken[order[nth >= most]] = False
    return taken


def _overlaps(
    start: np.ndarray, end: np.ndarray, video: np.ndarray, gap: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Pairs of clips of one video that are less than `gap` ms apart;
    None when they are too many to list.
    """
    order = np.lexsort((start, video))
    begin, finish, of = start[order], end[order], video[order]
    reach = int((finish - begin).max(initial=0)) + gap
    ones, others, listed = [order[:0]], [order[:0]], 0
    for step in range(1, len(order)):
        possible = (of[step:] == of[:-step]) & (begin[step:] < begin[:-step] + reach)
        if not possible.any():
            break
        touch = np.flatnonzero(
            possible & (begin[step:] < finish[:-step] + gap) & (begin[:-step] < finish[step:] + gap)
        )
        ones.append(order[touch])
        others.append(order[touch + step])
        listed += len(touch)
        if (step > _CROWDED and listed > _CROWDED * len(order)) or step > 50 * _CROWDED:
            return None
    return np.concatenate(ones), np.concatenate(others)


def _one_by_one(
    start: np.ndarray, end: np.ndarray, video: np.ndarray, place: np.ndarray, gap: int
) -> np.ndarray:
    """Clips taken in the order of their rank: for crowds at one moment,
    where pairs of neighbours are too many.
    """
    taken = np.zeros(len(start), bool)
    kept: dict[int, list[tuple[int, int]]] = {}
    begins, ends, of = start.tolist(), end.tolist(), video.tolist()
    for one in np.argsort(place).tolist():
        inside = kept.setdefault(of[one], [])
        at = bisect.bisect(inside, (begins[one], ends[one]))
        # Kept clips are in order of their start; unless they may overlap, only the two beside can
        # be too near.
        near = inside if gap < 0 else inside[max(at - 1, 0) : at + 1]
        if all(begins[one] >= finish + gap or begin >= ends[one] + gap for begin, finish in near):
            inside.insert(at, (begins[one], ends[one]))
            taken[one] = True
    return taken
