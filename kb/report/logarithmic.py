"""Counts of people on a logarithmic axis: views, votes."""

from __future__ import annotations

import math

from kb.core.profile import Profile
from kb.report.charts import histogram
from kb.report.data import ReportData
from kb.report.style import BLUE, PURPLE, Figure, number, saved


def views(data: ReportData, profile: Profile) -> Figure | None:
    """View counts on a logarithmic axis."""
    return _logarithmic(
        data,
        "youtube/videos",
        "view_count",
        "youtube-views",
        "How often they were watched",
        "views of a video (logarithmic)",
        "videos",
        "views",
        BLUE,
    )


def scores(data: ReportData, profile: Profile) -> Figure | None:
    """Reddit scores on a logarithmic axis."""
    return _logarithmic(
        data,
        "reddit/posts",
        "score",
        "reddit-scores",
        "How posts were voted",
        "score of a post (logarithmic)",
        "posts",
        "points",
        PURPLE,
    )


def _logarithmic(
    data: ReportData,
    table: str,
    column: str,
    name: str,
    title: str,
    x: str,
    y: str,
    unit: str,
    color: str,
) -> Figure | None:
    high, middle, low = (data.quantile(table, column, share) for share in (1.0, 0.5, 0.0))
    if high is None or middle is None or low is None or high < 1:
        return None
    first, last = math.floor(math.log10(max(low, 1))), math.ceil(math.log10(high + 1))
    steps = max(1, (last - first) * 6)
    edges = [10 ** (first + (last - first) * step / steps) for step in range(steps + 1)]
    values = data.histogram(table, column, edges)
    sheet = histogram(
        edges,
        values,
        x=x,
        y=y,
        log=True,
        color=color,
        marks=[(max(middle, edges[0]), f"median {number(middle)}")],
    )
    return Figure(
        name,
        title,
        f"Half of the {y} have {number(middle)} {unit} or fewer, the largest has {number(high)}.",
        (
            f"Histogram of {unit} per row on a logarithmic axis from {number(edges[0])} to "
            f"{number(edges[-1])}, median {number(middle)}."
        ),
        saved(sheet),
        (unit, y),
        [
            (f"{number(a)} to {number(b)}", n)
            for a, b, n in zip(edges, edges[1:], values, strict=False)
        ],
    )
