"""Confidence intervals of shares."""

import math

_Z = 1.959964  # of the normal distribution, for 95 %


def wilson_interval(hits: float, n: float) -> tuple[float, float]:
    """The 95 % score interval of a share of `n` (Wilson, JASA 1927); (0, 1) where `n` is 0.

    `hits` and `n` may be fractions, as of weighted samples, where `n` is the effective size.
    """
    if n <= 0:
        return 0.0, 1.0
    middle = (hits + _Z * _Z / 2) / (n + _Z * _Z)
    half = _Z * math.sqrt(max(hits * (n - hits), 0) / n + _Z * _Z / 4) / (n + _Z * _Z)
    return max(0.0, middle - half), min(1.0, middle + half)
