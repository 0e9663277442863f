"""Plain kinds of chart: lying bars, histograms, bars over time. Every axis says what it counts."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

from kb.report.figure_style import BLUE, GREY, canvas, counts, number, powers

# Behind a number: the grid's lines stop before it.
HALO = {"facecolor": "white", "edgecolor": "none", "pad": 1.2}


def bars(
    labels: Sequence[str],
    values: Sequence[float],
    *,
    unit: str,
    notes: Sequence[str] | None = None,
    colors: Sequence[str] | str = BLUE,
    axes: Any = None,
) -> Any:
    """Horizontal bars, the first on top, each with its number written behind it."""
    height = 0.9 + 0.32 * max(2, len(labels))
    sheet, axes = canvas(height) if axes is None else (axes.figure, axes)
    places = range(len(labels))
    axes.barh(places, values, color=colors, height=0.72)
    axes.set_yticks(places, labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlabel(unit)
    counts(axes.xaxis)
    axes.set_xlim(0, max([*values, 1]) * 1.32)
    for place, value, note in zip(
        places, values, notes or [number(value) for value in values], strict=True
    ):
        axes.text(
            value + max([*values, 1]) * 0.012,
            place,
            note,
            va="center",
            ha="left",
            fontsize=9,
            color=GREY if not value else None,
            bbox=HALO,
        )
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")
    return sheet


def histogram(
    edges: Sequence[float],
    values: Sequence[int],
    *,
    x: str,
    y: str,
    log: bool = False,
    color: str = BLUE,
    axes: Any = None,
    marks: Sequence[tuple[float, str]] = (),
) -> Any:
    """Bars between edges; `log` for a logarithmic x axis; `marks`: vertical lines with a word."""
    sheet, axes = canvas(2.9) if axes is None else (axes.figure, axes)
    widths = [high - low for low, high in itertools.pairwise(edges)]
    axes.bar(
        edges[:-1], values, widths, align="edge", color=color, edgecolor="white", linewidth=0.6
    )
    if log:
        axes.set_xscale("log")
        powers(axes.xaxis)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_xlim(edges[0], edges[-1])
    counts(axes.yaxis)
    axes.grid(axis="y")
    top = max([*values, 1])
    axes.set_ylim(0, top * (1.22 if marks else 1.06))
    for place, word in marks:
        axes.axvline(place, color=GREY, linewidth=1.2, linestyle=(0, (4, 2)), ymax=0.86)
        far = place > (edges[0] * edges[-1]) ** 0.5 if log else place > (edges[0] + edges[-1]) / 2
        axes.annotate(
            word,
            (place, top * 1.18),
            xytext=(-4 if far else 4, 0),
            textcoords="offset points",
            ha="right" if far else "left",
            va="top",
            fontsize=9,
        )
    return sheet


def over_time(
    periods: Sequence[str],
    values: Sequence[int],
    *,
    x: str,
    y: str,
    color: str = BLUE,
    axes: Any = None,
    labels: int = 5,
) -> Any:
    """One bar a period, in order; about `labels` of the periods are named below them."""
    sheet, axes = canvas(2.9) if axes is None else (axes.figure, axes)
    axes.bar(range(len(periods)), values, width=0.86, color=color)
    room = max(0, 4 - len(periods)) / 2  # a single bar is no wall
    axes.set_xlim(-0.6 - room, len(periods) - 0.4 + room)
    step = max(1, math.ceil(len(periods) / labels))
    shown = range(0, len(periods), step)
    axes.set_xticks(shown, [periods[index] for index in shown])
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_ylim(0, max([*values, 1]) * 1.08)
    counts(axes.yaxis)
    axes.grid(axis="y")
    return sheet


def even(low: float, high: float, bins: int = 30) -> list[float]:
    """Edges of bins of one width."""
    return [low + (high - low) * step / bins for step in range(bins + 1)]
