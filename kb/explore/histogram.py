"""The histogram of a stage's numbers, whose bars end where the slider stops."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import duckdb

_BARS = 60
_DIGITS = 3  # of an edge


class HistogramBar(NamedTuple):
    """A bar of rows from one edge to the next, its parts as shares of the highest bar."""

    low: float
    high: float
    kept: int
    deciding: int  # rejected by this stage alone
    others: int  # rejected here, and not kept by the other stages either
    scale: int

    @property
    def heights(self) -> list[tuple[str, float, float]]:
        """(part, top, height) in a box of 100, from the ground up."""
        parts, ground = [], 100.0
        for name in ("kept", "deciding", "others"):
            height = 100 * getattr(self, name) / self.scale
            ground -= height
            parts.append((name, round(ground, 3), round(height, 3)))
        return parts


class Histogram(NamedTuple):
    """Bars in order; the slider has the positions 0 to `len(edges) - 1`.

    `current` and `position` are those of the current threshold and of the one that is tried.
    """

    bars: list[HistogramBar]
    edges: list[float]
    current: int
    position: int


def edges_of(con: duckdb.DuckDBPyConnection, current: float, at_least: bool) -> list[float]:
    """The values that the slider offers, ascending, for the table `numbers` of a connection.

    They are spaced evenly near zero and in proportion further out (an inverse hyperbolic sine),
    and include the current threshold.
    """
    low, high, scale, whole = con.execute(
        """SELECT min(number), max(number), quantile_disc(abs(number), 0.1) FILTER (number != 0),
        bool_and(number = floor(number)) FROM numbers"""
    ).fetchall()[0]
    if low is None:
        return [current]
    low, high, scale = min(low, current), max(high, current), scale or 1
    start, end = math.asinh(low / scale), math.asinh(high / scale)
    steps = (start + (end - start) * step / _BARS for step in range(_BARS + 1))
    inner = {_rounded(scale * math.sinh(step), whole) for step in steps}
    beyond = {_beyond(high, whole)} if at_least else {_beyond(low, whole, -1)}
    return sorted({one for one in inner if low < one < high} | {low, high, current} | beyond)


def _rounded(value: float, whole: bool) -> float:
    digits = _DIGITS - 1 - math.floor(math.log10(abs(value))) if value else 0
    rounded = round(value, digits)
    return float(round(rounded)) if whole else rounded


def _beyond(value: float, whole: bool, sign: int = 1) -> float:
    """The next value that no row passes."""
    return value + sign if whole else value + sign * max(abs(value) * 0.01, 1e-6)


def draw(
    con: duckdb.DuckDBPyConnection,
    edges: list[float],
    current: float,
    value: float,
    at_least: bool,
) -> Histogram:
    """The rows of the table `numbers` between two edges each. A row on an edge belongs to the bar
    whose rows pass with that edge as the limit.
    """
    # histogram() counts up to and including each bin; mirrored, from each bin on.
    sign, bins = ("-", [-edge for edge in reversed(edges)]) if at_least else ("", edges)
    of_parts = con.execute(
        f"""SELECT histogram({sign}number, $bins) FILTER (kept),
        histogram({sign}number, $bins) FILTER (NOT kept AND outcome != 'rejected'),
        histogram({sign}number, $bins) FILTER (NOT kept AND outcome = 'rejected') FROM numbers""",
        {"bins": bins},
    ).fetchall()[0]
    counts = []
    for part in of_parts:
        by_bin = part or {}
        bars = [by_bin.get(edge, 0) for edge in bins[1:]]
        counts.append(bars[::-1] if at_least else bars)
    highest = max(map(sum, zip(*counts, strict=True)), default=0) or 1
    bars = [
        HistogramBar(low, high, kept, deciding, others, highest)
        for (low, high), kept, deciding, others in zip(pairwise(edges), *counts, strict=True)
    ]
    nearest = min(range(len(edges)), key=lambda place: abs(edges[place] - value))
    return Histogram(bars, edges, edges.index(current), nearest)
