"""Figures that several sources share. Each takes the data, the profile, and what differs."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from kb.core.config.profile import Profile
from kb.look.charts import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    Figure,
    bars,
    canvas,
    histogram,
    number,
    over_time,
    saved,
)
from kb.look.headings import reading
from kb.report.data import ReportData

_SCORES = [step / 20 for step in range(21)]


FigureMaker = Callable[[ReportData, Profile], "Figure | tuple[Figure, ...] | None"]


def bar_figure(
    name: str,
    title: str,
    caption: str,
    rows: Sequence[tuple[Any, ...]],
    *,
    head: Sequence[str],
    unit: str = "",
    described: str = "",
    labels: Sequence[str] = (),
    named: int | None = None,
    at: int = 1,
    **options: Any,
) -> Figure:
    """Bars of rows (label, …) by the number at the place `at`.

    `described` says in words what the bars are of; `named` limits how many of them the description
    lists. Other options are those of `bars`.
    """
    unit = unit or head[at]
    listed = ", ".join(f"{row[0]} {row[at]:,}" for row in rows[:named])
    names = labels or [row[0] for row in rows]
    sheet = bars(names, [row[at] for row in rows], unit=unit, **options)
    alt = f"Bars of {described or f'{unit} by {head[0]}'}: {listed}."
    return Figure(name, title, caption, alt, saved(sheet), head, rows)


def values(
    data: ReportData,
    profile: Profile,
    table: str,
    column: str,
    *,
    name: str,
    title: str,
    caption: str,
    head: tuple[str, str],
    colors: Mapping[str, str],
    shares: bool = True,
) -> Figure | None:
    """Rows by the most frequent values of a column, in their words; `colors` has that of each."""
    top = data.top(table, column, 12)
    total = sum(n for _, n in top)
    if not total:
        return None
    return bar_figure(
        name,
        title,
        caption.format(total=f"{total:,}"),
        [(reading(table, column, value), n) for value, n in top],
        head=head,
        notes=[number(n) + (f"  ({n / total:.0%})" if shares else "") for _, n in top],
        colors=[colors.get(value, BLUE) for value, _ in top],
    )


def funnel(data: ReportData, profile: Profile, name: str) -> Figure | None:
    """What is left of a table after each filter stage."""
    rows = data.funnel(name)
    if not rows:
        return None
    crawled, kept = rows[0][1], rows[-1][1]
    what = name.partition("/")[2]
    return bar_figure(
        f"{name.replace('/', '-')}-funnel",
        f"What the filters leave of the {what}",
        f"{kept:,} of {crawled:,} {what} are kept ({kept / crawled:.0%}). "
        "In brackets: what each stage dropped.",
        rows,
        head=("stage", "left", "dropped"),
        unit=f"{what} left after the stage",
        described=f"{what} left after each stage",
        notes=[
            number(n) + (f"  (−{number(dropped)})" if dropped else "") for _, n, dropped in rows
        ],
        colors=[PALE, *[BLUE] * (len(rows) - 2), GREEN],
    )


def dates(
    data: ReportData, profile: Profile, table: str, column: str, what: str, color: str
) -> Figure | None:
    """Rows of a table by the time in a column; `what` happened then, in words."""
    timeline = data.timeline(table, column)
    if timeline is None:
        return None
    step, periods = timeline
    source, _, rows = table.partition("/")
    names, counts = [name for name, _ in periods], [n for _, n in periods]
    most, n = max(periods, key=lambda period: period[1])
    when = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    sheet = over_time(names, counts, x=f"{step} (UTC)", y=f"{rows} {what}", color=color)
    return Figure(
        f"{source}-dates",
        f"When {rows} were {what}",
        f"{sum(counts):,} {rows} by {step}, {when}; most in {most} ({number(n)}).",
        f"Bars of {rows} by the {step} in which they were {what}, {when}; most in {most}, {n:,}.",
        saved(sheet),
        (step, rows),
        periods,
    )


def logarithmic(
    data: ReportData,
    profile: Profile,
    table: str,
    column: str,
    *,
    name: str,
    title: str,
    x: str,
    unit: str,
    color: str,
) -> Figure | None:
    """A count that people make, such as views, on a logarithmic axis."""
    high, middle, low = (data.quantile(table, column, share) for share in (1.0, 0.5, 0.0))
    if high is None or middle is None or low is None or high < 1:
        return None
    rows = table.partition("/")[2]
    first, last = math.floor(math.log10(max(low, 1))), math.ceil(math.log10(high + 1))
    steps = max(1, (last - first) * 6)
    edges = [10 ** (first + (last - first) * step / steps) for step in range(steps + 1)]
    counts = data.histogram(table, column, edges)
    mark = max(middle, edges[0]), f"median {number(middle)}"
    sheet = histogram(edges, counts, x=x, y=rows, log=True, color=color, marks=[mark])
    return Figure(
        name,
        title,
        f"Half of the {rows} have {number(middle)} {unit} or fewer, the largest has"
        f" {number(high)}.",
        f"Histogram of {unit} per row on a logarithmic axis from {number(edges[0])} to"
        f" {number(edges[-1])}, median {number(middle)}.",
        saved(sheet),
        (unit, rows),
        [
            (f"{number(a)} to {number(b)}", n)
            for (a, b), n in zip(itertools.pairwise(edges), counts, strict=True)
        ],
    )


def toxicity(
    data: ReportData, profile: Profile, table: str, columns: tuple[str, ...]
) -> Figure | None:
    """Rows of a table by the largest score of their texts, on a logarithmic axis of counts."""
    kept = data.histogram(table, f"greatest({', '.join(columns)})", _SCORES)
    dropped = data.dropped_scores(table, _SCORES)
    if not sum(kept) + sum(dropped):
        return None
    source, _, rows = table.partition("/")
    threshold = profile.toxicity.threshold(source)
    sheet, axes = canvas(3.1)
    style = {"align": "edge", "edgecolor": "white", "linewidth": 0.6}
    for counts, label, color, hatch in (
        (kept, "kept", BLUE, None),
        (dropped, "dropped for it", ORANGE, "////"),
    ):
        if sum(counts):
            axes.bar(_SCORES[:-1], counts, 0.05, color=color, hatch=hatch, label=label, **style)
    axes.set_yscale("log")
    axes.set_ylim(0.6, max(*kept, *dropped) * 3)
    axes.yaxis.set_major_formatter(lambda value, _: number(value))
    axes.yaxis.minorticks_off()
    axes.set_xlim(0, 1)
    axes.set_xlabel("largest score of the row's texts (0 to 1)")
    axes.set_ylabel(f"{rows} (logarithmic)")
    axes.grid(axis="y")
    limit = "none is dropped for it"
    if threshold is not None:
        limit = f"dropped above {threshold:g}"
        label = f"threshold {threshold:g}"
        axes.axvline(threshold, color=GREY, linewidth=1.4, linestyle=(0, (4, 2)), label=label)
    sheet.legend(loc="outside upper center", ncols=3, handlelength=1.6, columnspacing=1.2)
    return Figure(
        f"{source}-{rows}-toxicity",
        f"How the model scored the {rows}",
        f"The largest score of a row's texts in any category, {limit}. {sum(kept):,} {rows} kept, "
        f"{sum(dropped):,} dropped; rows without any text have no score.",
        f"Histogram of toxicity scores from 0 to 1: {kept[0]:,} kept {rows} are below 0.05, "
        f"{sum(dropped):,} were dropped.",
        saved(sheet),
        ("score", "kept", "dropped"),
        [
            (f"{low:.2f} to {high:.2f}", a, b)
            for (low, high), a, b in zip(itertools.pairwise(_SCORES), kept, dropped, strict=True)
        ],
    )
