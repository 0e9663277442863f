"""What is left of a table after each filter stage."""

from __future__ import annotations

from kb.core.profile import Profile
from kb.report.charts import bars
from kb.report.data import Funnel, ReportData
from kb.report.style import BLUE, GREEN, PALE, Figure, number, saved

NAMES = {
    "youtube/videos": "videos",
    "wiki/pages": "pages",
    "reddit/posts": "posts",
    "reddit/comments": "comments",
}


def funnel(data: ReportData, profile: Profile, name: str) -> Figure | None:
    """What is left after each filter stage."""
    counts = data.funnel(name)
    if counts is None:
        return None
    lines = _steps(counts)
    labels = [label for label, _, _ in lines]
    left = [n for _, n, _ in lines]
    notes = [number(n) + (f"  (−{number(gone)})" if gone else "") for _, n, gone in lines]
    colors = [
        PALE if index == 0 else GREEN if index == len(lines) - 1 else BLUE
        for index in range(len(lines))
    ]
    what = NAMES.get(name, name)
    sheet = bars(labels, left, unit=f"{what} left after the stage", notes=notes, colors=colors)
    share = counts.kept / counts.crawled if counts.crawled else 0
    return Figure(
        f"{name.replace('/', '-')}-funnel",
        f"What the filters leave of the {what}",
        f"{counts.kept:,} of {counts.crawled:,} {what} are kept ({share:.0%}). "
        "In brackets: what each stage dropped.",
        f"Bars of {what} left after each stage: "
        + ", ".join(f"{label} {n:,}" for label, n, _ in lines)
        + ".",
        saved(sheet),
        ("stage", "left", "dropped"),
        [(label, n, gone) for label, n, gone in lines],
    )


def _steps(counts: Funnel) -> list[tuple[str, int, int]]:
    """(label, rows left, rows gone) from what was crawled to what is kept."""
    left = counts.crawled
    lines = [("crawled", left, 0)]
    for stage, gone in (*counts.dropped, ("failed", counts.failed), ("pending", counts.pending)):
        if stage in ("failed", "pending") and not gone:
            continue
        left -= gone
        lines.append((stage.replace("_", " "), left, gone))
    return [*lines, ("kept", counts.kept, 0)]
