"""The histogram of a stage's numbers, whose bars end where the slider stops."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise, product
from typing import NamedTuple

import duckdb

from kb.look.charts import number, step

_BARS = 40
_DIGITS = 3  # of an edge
_NEAR = (16, 7)  # least distance of two ticks, percent of the axis: on narrow and on wide pages


class HistogramBar(NamedTuple):
    """A bar of rows from one edge to the next, its parts as shares of the highest bar."""

    low: float
    high: float
    kept: int
    deciding: int  # rejected by this stage alone
    others: int  # rejected here, and not kept by the other stages either
    scale: int

    @property
    def rows(self) -> int:
        """All rows of the bar."""
        return self.kept + self.deciding + self.others

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

    @property
    def is_wide(self) -> bool:
        """Whether the numbers spread over powers of ten, so that equal steps multiply."""
        sizes = [abs(edge) for edge in self.edges if edge]
        return bool(sizes) and max(sizes) > 100 * min(sizes)

    @property
    def x_ticks(self) -> list[tuple[float, str, bool]]:
        """(percent, number, whether narrow pages leave it out) along the bars, none too near to
        another.
        """
        chosen: dict[float, tuple[float, bool]] = {}
        for near in _NEAR:
            for tick in _round_numbers(self.edges[0], self.edges[-1]):
                place = self._percent(tick)
                if all(abs(place - other) >= near for other, _ in chosen.values()):
                    chosen[tick] = place, near < max(_NEAR)
        return [(round(at, 3), tick_label(n), minor) for n, (at, minor) in sorted(chosen.items())]

    @property
    def y_ticks(self) -> list[tuple[float, str]]:
        """(percent from the top, number) of rows."""
        top = self.bars[0].scale if self.bars else 1
        apart = max(1, round(step(top, 5)))
        return [(round(100 - 100 * n / top, 3), f"{n:,}") for n in range(0, top + 1, apart)]

    def _percent(self, value: float) -> float:
        """Where a number stands along the bars, which are all of one width."""
        place = max(0, min(bisect_right(self.edges, value), len(self.edges) - 1) - 1)
        below, above = self.edges[place : place + 2]
        return 100 * (place + (value - below) / (above - below)) / (len(self.edges) - 1)


def tick_label(tick: float) -> str:
    """The number at a tick, as short as it can be read."""
    return number(tick) if abs(tick) >= 1000 else f"{tick:g}"


def _round_numbers(low: float, high: float) -> Iterator[float]:
    """Numbers for an axis, those that people prefer first: 0, powers of ten, halves, fifths."""
    powers = [10.0**power for power in range(-6, 12)]
    for leading in (0, 1, 5, 2, 3, 1.5, 7, 4, 2.5, 6, 8, 9):
        for sign, power in product((1, -1), powers if leading else powers[:1]):
            tick = round(sign * leading * power, 7)
            if low <= tick <= high:
                yield tick


def edges_of(con: duckdb.DuckDBPyConnection, current: float, at_least: bool) -> list[float]:
    """The values that the slider offers, ascending, for the table `numbers` of a connection.

    They are spaced evenly near zero and in proportion further out (an inverse hyperbolic sine),
    and include the current threshold.
    """
    low, high, scale, is_whole = con.execute(
        """SELECT min(number), max(number), quantile_disc(abs(number), 0.1) FILTER (number != 0),
        bool_and(number = floor(number)) FROM numbers"""
    ).fetchall()[0]
    if low is None:
        return [current]
    low, high, scale = min(low, current), max(high, current), scale or 1
    start, end = math.asinh(low / scale), math.asinh(high / scale)
    steps = (start + (end - start) * part / _BARS for part in range(_BARS + 1))
    inner = {_rounded(scale * math.sinh(step), is_whole) for step in steps}
    beyond = {_beyond(high, is_whole)} if at_least else {_beyond(low, is_whole, -1)}
    return sorted({value for value in inner if low < value < high} | {low, high, current} | beyond)


def _rounded(value: float, is_whole: bool) -> float:
    digits = _DIGITS - 1 - math.floor(math.log10(abs(value))) if value else 0
    rounded = round(value, digits)
    return float(round(rounded)) if is_whole else rounded


def _beyond(value: float, is_whole: bool, sign: int = 1) -> float:
    """The next value that no row passes."""
    return value + sign if is_whole else value + sign * max(abs(value) * 0.01, 1e-6)


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
    apart = max(1, round(step(highest, 5)))
    top = -(-highest // apart) * apart
    bars = [
        HistogramBar(low, high, kept, deciding, others, top)
        for (low, high), kept, deciding, others in zip(pairwise(edges), *counts, strict=True)
    ]
    nearest = min(range(len(edges)), key=lambda place: abs(edges[place] - value))
    return Histogram(bars, edges, edges.index(current), nearest)
