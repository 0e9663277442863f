"""Intervals of shares, against published figures and by their definition."""

import math

import pytest

from kb.core.summary.intervals import wilson_interval


@pytest.mark.parametrize(
    ("hits", "n", "expected"),
    [  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
        (81, 263, (0.2553, 0.3662)),
        (15, 148, (0.0624, 0.1605)),
        (0, 20, (0.0, 0.1611)),
        (1, 29, (0.0061, 0.1718)),
        (0, 0, (0.0, 1.0)),
    ],
)
def test_published_intervals(hits: int, n: int, expected: tuple[float, float]) -> None:
    assert wilson_interval(hits, n) == pytest.approx(expected, abs=5e-5)


def test_the_ends_are_the_shares_that_a_score_test_does_not_reject() -> None:
    for end in wilson_interval(7, 40):
        assert abs(7 / 40 - end) / math.sqrt(end * (1 - end) / 40) == pytest.approx(1.96, abs=1e-4)
