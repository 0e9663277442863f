"""The choice of clips: all at once gives what one by one gives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.pairs import seeded_random


def one_by_one(clips, gap, most):
    """Clips in the order of their rank; each that keeps its distance from all taken before."""
    taken: list[int] = []
    for at in sorted(range(len(clips)), key=lambda at: (clips[at][3], at)):
        start, end, video, _ = clips[at]
        mine = [clips[other] for other in taken if clips[other][2] == video]
        if (not most or len(mine) < most) and all(
            start >= other[1] + gap or other[0] >= end + gap for other in mine
        ):
            taken.append(at)
    return sorted(taken)


_clips = st.lists(
    st.tuples(st.integers(0, 90), st.integers(0, 16), st.integers(0, 2), st.integers(0, 9)),
    max_size=25,
)


@settings(max_examples=100, deadline=None)
@given(_clips, st.integers(-10, 10), st.integers(0, 3))
def test_like_one_by_one(clips, gap, most):
    clips = [(start, start + length, video, rank) for start, length, video, rank in clips]
    start, end, video, rank = (np.array([clip[at] for clip in clips], np.int64) for at in range(4))
    taken = seeded_random.choose(start, end, video, rank.astype(np.uint64), gap, most)
    assert np.flatnonzero(taken).tolist() == one_by_one(clips, gap, most)


@pytest.mark.parametrize(
    ("center", "length", "video", "expected"),
    [
        (50, 10, 100, (45, 55)),
        (2, 10, 100, (0, 10)),
        (99, 10, 100, (90, 100)),
        (3, 10, 6, (0, 6)),
        (0, 10, 0, (0, 0)),
    ],
)
def test_clips_stay_inside_the_video(
    center: int, length: int, video: int, expected: tuple[int, int]
) -> None:
    start, end = seeded_random.clips(*(np.array([value]) for value in (center, length, video)))
    assert (start[0], end[0]) == expected
