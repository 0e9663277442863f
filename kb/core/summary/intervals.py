"""Confidence intervals of shares."""

import math
from collections.abc import Mapping
from typing import Any

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


def interval_text(share: Mapping[str, Any]) -> str:
    """A share with its interval: "0.962 (0.945 to 0.974)"; "-" where there is none."""
    if share.get("share") is None:
        return "-"
    return "{share:.3f} ({low:.3f} to {high:.3f})".format_map(share)


def share_of(hits: int, n: int) -> dict[str, Any]:
    """A share as measures give it: `hits`, `n`, `share` (None where `n` is 0), and the ends `low`
    and `high` of its interval.
    """
    low, high = (round(end, 4) for end in wilson_interval(hits, n))
    share = round(hits / n, 4) if n else None
    return {"hits": hits, "n": n, "share": share, "low": low, "high": high}
