"""The figures: the paper's own (durations, post types, word cloud) and what a builder wants to see.

Each function takes the data and answers a finished Figure, or None when there is nothing to show.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from kb.report.charts import histogram, lying_bars
from kb.report.data import Data, Funnel
from kb.report.style import (
    BLUE,
    GREEN,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    SERIES,
    SKY,
    Figure,
    canvas,
    counts,
    number,
    saved,
)

if TYPE_CHECKING:
    from kb.core.profile import Profile

_BINS = 30
NAMES = {
    "youtube/videos": "videos",
    "wiki/pages": "pages",
    "reddit/posts": "posts",
    "reddit/comments": "comments",
}
TYPE_COLORS = {
    "text": BLUE,
    "image": ORANGE,
    "video": GREEN,
    "link": PURPLE,
    "poll": SKY,
    "gallery": RED,
}


def _figure(
    name: str,
    title: str,
    caption: str,
    alt: str,
    sheet: Any,
    head: Sequence[str] = (),
    rows: Sequence[Sequence[object]] = (),
) -> Figure:
    png, svg = saved(sheet)
    return Figure(name, title, caption, alt, png, svg, head, rows)


def durations(data: Data, profile: Profile) -> Figure | None:
    """Video durations, trimmed at a percentile (the paper's figure)."""
    percent = profile.report.trim_percentile
    high = data.quantile("youtube/videos", "duration_s", percent / 100)
    middle = data.quantile("youtube/videos", "duration_s", 0.5)
    if high is None or middle is None:
        return None
    low = float(profile.youtube.min_duration_s) if profile.youtube else 0.0
    edges = _even(min(low, high), max(high, low + 60))
    values = data.histogram("youtube/videos", "duration_s", edges)
    minutes = [edge / 60 for edge in edges]
    sheet = histogram(
        minutes,
        values,
        x="duration (minutes)",
        y="videos",
        marks=[(middle / 60, f"median {middle / 60:.1f} min")],
    )
    return _figure(
        "youtube-durations",
        "How long the videos are",
        (
            f"Durations up to the {percent:g}th percentile ({high / 60:.1f} minutes); the longest {100 - percent:g}% are left out, as in the paper."
        ),
        (
            f"Histogram of video durations from {minutes[0]:.0f} to {minutes[-1]:.1f} minutes; half of the videos are "
            f"shorter than {middle / 60:.1f} minutes."
        ),
        sheet,
        ("minutes", "videos"),
        [(f"{a:.1f} to {b:.1f}", n) for a, b, n in zip(minutes, minutes[1:], values, strict=False)],
    )


def views(data: Data, profile: Profile) -> Figure | None:
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


def scores(data: Data, profile: Profile) -> Figure | None:
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
    data: Data,
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
    return _figure(
        name,
        title,
        f"Half of the {y} have {number(middle)} {unit} or fewer, the largest has {number(high)}.",
        (
            f"Histogram of {unit} per row on a logarithmic axis from {number(edges[0])} to {number(edges[-1])}, median {number(middle)}."
        ),
        sheet,
        (unit, y),
        [
            (f"{number(a)} to {number(b)}", n)
            for a, b, n in zip(edges, edges[1:], values, strict=False)
        ],
    )


def post_types(data: Data, profile: Profile) -> Figure | None:
    """Shares of post types (the paper's figure)."""
    found = data.top("reddit/posts", "type", 12)
    total = sum(n for _, n in found)
    if not total:
        return None
    names, values = [name for name, _ in found], [n for _, n in found]
    notes = [f"{number(n)}  ({n / total:.0%})" for n in values]
    sheet = lying_bars(
        names,
        values,
        unit="posts",
        notes=notes,
        colors=[TYPE_COLORS.get(name, BLUE) for name in names],
    )
    return _figure(
        "reddit-types",
        "What kinds of posts there are",
        f"{total:,} kept posts by type; a crosspost has its parent's type.",
        "Bars of posts by type: " + ", ".join(f"{name} {n:,}" for name, n in found) + ".",
        sheet,
        ("type", "posts"),
        found,
    )


def funnel(data: Data, name: str) -> Figure | None:
    """What is left after each filter stage."""
    found = data.funnel(name)
    if found is None:
        return None
    lines = _steps(found)
    labels = [label for label, _, _ in lines]
    left = [n for _, n, _ in lines]
    notes = [number(n) + (f"  (−{number(gone)})" if gone else "") for _, n, gone in lines]
    colors = [
        PALE if index == 0 else GREEN if index == len(lines) - 1 else BLUE
        for index in range(len(lines))
    ]
    what = NAMES.get(name, name)
    sheet = lying_bars(
        labels, left, unit=f"{what} left after the stage", notes=notes, colors=colors
    )
    share = found.kept / found.crawled if found.crawled else 0
    return _figure(
        f"{name.replace('/', '-')}-funnel",
        f"What the filters leave of the {what}",
        f"{found.kept:,} of {found.crawled:,} {what} are kept ({share:.0%}). In brackets: what each stage dropped.",
        f"Bars of {what} left after each stage: "
        + ", ".join(f"{label} {n:,}" for label, n, _ in lines)
        + ".",
        sheet,
        ("stage", "left", "dropped"),
        [(label, n, gone) for label, n, gone in lines],
    )


def _steps(found: Funnel) -> list[tuple[str, int, int]]:
    """(label, rows left, rows gone) from what was crawled to what is kept."""
    left = found.crawled
    lines = [("crawled", left, 0)]
    for stage, gone in (*found.dropped, ("failed", found.failed), ("pending", found.pending)):
        if stage in ("failed", "pending") and not gone:
            continue
        left -= gone
        lines.append((stage.replace("_", " "), left, gone))
    return [*lines, ("kept", found.kept, 0)]


def quota(data: Data, profile: Profile) -> Figure | None:
    """Units of YouTube's quota, or requests of the others, over days."""
    rows = [
        (day, f"{source} {bucket}" if bucket != source else source, units or requests)
        for source, day, bucket, requests, units in data.ledgers()
    ]
    if not rows:
        return None
    days = sorted({day for day, _, _ in rows})[-60:]
    buckets = sorted({bucket for _, bucket, _ in rows})
    sheet, axes = canvas(2.9)
    base = [0.0] * len(days)
    for index, bucket in enumerate(buckets):
        values = [sum(n for day, name, n in rows if day == one and name == bucket) for one in days]
        axes.bar(
            range(len(days)),
            values,
            bottom=base,
            width=0.6,
            color=SERIES[index % len(SERIES)],
            label=bucket,
            edgecolor="white",
            linewidth=0.6,
        )
        base = [a + b for a, b in zip(base, values, strict=True)]
    axes.set_xlim(-0.5 - max(0, 3 - len(days)) / 2, len(days) - 0.5 + max(0, 3 - len(days)) / 2)
    shown = list(range(0, len(days), max(1, math.ceil(len(days) / 5))))
    axes.set_xticks(shown, [days[index][5:] for index in shown])
    axes.set_xlabel(f"day (month-day, {' to '.join(dict.fromkeys((days[0][:4], days[-1][:4])))})")
    axes.set_ylabel("units (YouTube), requests (others)")
    axes.set_ylim(0, max([*base, 1]) * (1.12 + 0.09 * math.ceil(len(buckets) / 2)))
    counts(axes.yaxis)
    axes.grid(axis="y")
    axes.legend(loc="upper left", ncols=2)
    sums = [(bucket, sum(n for _, name, n in rows if name == bucket)) for bucket in buckets]
    return _figure(
        "quota",
        "What the services were asked",
        "Spent over days: units of YouTube's quota, requests of the other services.",
        "Stacked bars by day; in all " + ", ".join(f"{bucket} {n:,}" for bucket, n in sums) + ".",
        sheet,
        ("day", "bucket", "spent"),
        rows,
    )


def keywords(data: Data, profile: Profile) -> Figure | None:
    """Pairs for each of the most frequent keywords."""
    found = data.top("pairs/pairs", "keyword", profile.report.top_keywords)
    if not found:
        return None
    total = data.count("pairs/pairs")
    distinct = data.rows("pairs/pairs", "SELECT count(DISTINCT keyword) FROM {t}")[0][0]
    sheet = lying_bars(
        [name for name, _ in found], [n for _, n in found], unit="pairs", colors=GREEN
    )
    return _figure(
        "pairs-keywords",
        "Which keywords are spoken",
        f"{total:,} pairs of {distinct:,} keywords; the {len(found)} most frequent.",
        "Bars of pairs by keyword: " + ", ".join(f"{name} {n:,}" for name, n in found[:10]) + ".",
        sheet,
        ("keyword", "pairs"),
        found,
    )


def lengths(data: Data, profile: Profile) -> Figure | None:
    """Lengths of clips and texts of the pairs."""
    found = data.rows(
        "pairs/pairs",
        (
            "SELECT min(token_count), max(token_count), min(clip_end_s - clip_start_s), max(clip_end_s - clip_start_s) FROM {t}"
        ),
    )
    if not found or found[0][0] is None:
        return None
    low, high, short, long = (float(value) for value in found[0])
    tokens = _even(low, max(high, low + 1) + 1, 20)
    clips = _even(short, max(long, short + 1), 20)
    by_token = data.histogram("pairs/pairs", "token_count", tokens)
    tests = ", ".join(
        f"count(*) FILTER (d >= {a!r} AND d {'<=' if b == clips[-1] else '<'} {b!r})"
        for a, b in itertools.pairwise(clips)
    )
    by_clip = [
        int(n)
        for n in data.rows(
            "pairs/pairs", f"SELECT {tests} FROM (SELECT clip_end_s - clip_start_s AS d FROM {{t}})"
        )[0]
    ]
    sheet, axes = canvas(2.7, 2)
    histogram(clips, by_clip, x="clip (seconds)", y="pairs", color=GREEN, axes=axes[0])
    histogram(tokens, by_token, x="text (CLIP tokens)", y="", color=ORANGE, axes=axes[1])
    return _figure(
        "pairs-lengths",
        "How long clips and texts are",
        f"Clips last {short:.1f} to {long:.1f} seconds, texts have {low:.0f} to {high:.0f} CLIP tokens.",
        (
            f"Two histograms: clip length from {short:.1f} to {long:.1f} seconds, text length from {low:.0f} to {high:.0f} tokens."
        ),
        sheet,
        ("seconds", "pairs"),
        [(f"{a:.1f} to {b:.1f}", n) for a, b, n in zip(clips, clips[1:], by_clip, strict=False)],
    )


def elements(data: Data, profile: Profile) -> Figure | None:
    """Elements of the wiki's pages by kind."""
    found = data.top("wiki/elements", "kind", 10)
    if not found:
        return None
    from kb.report.wikipage import KINDS

    sheet = lying_bars(
        [name for name, _ in found],
        [n for _, n in found],
        unit="elements",
        colors=[KINDS.get(name, BLUE) for name, _ in found],
    )
    total = sum(n for _, n in found)
    return _figure(
        "wiki-elements",
        "What is on the pages",
        f"{total:,} elements with a box, by kind.",
        "Bars of elements by kind: " + ", ".join(f"{name} {n:,}" for name, n in found) + ".",
        sheet,
        ("kind", "elements"),
        found,
    )


def _even(low: float, high: float, bins: int = _BINS) -> list[float]:
    """Edges of bins of one width."""
    return [low + (high - low) * step / bins for step in range(bins + 1)]
