"""The posts by type (the paper's figure)."""

from __future__ import annotations

from functools import partial

from kb.core.profile import Profile
from kb.report import cloud
from kb.report.charts import bars
from kb.report.data import ReportData
from kb.report.dates import dates
from kb.report.funnel import funnel
from kb.report.logarithmic import scores
from kb.report.style import BLUE, GREEN, ORANGE, PURPLE, RED, SKY, Figure, number, saved
from kb.report.toxicity import toxicity

TYPE_COLORS = {
    "text": BLUE,
    "image": ORANGE,
    "video": GREEN,
    "link": PURPLE,
    "poll": SKY,
    "gallery": RED,
}


def post_types(data: ReportData, profile: Profile) -> Figure | None:
    """Shares of post types (the paper's figure)."""
    top = data.top("reddit/posts", "type", 12)
    total = sum(n for _, n in top)
    if not total:
        return None
    names, values = [name for name, _ in top], [n for _, n in top]
    notes = [f"{number(n)}  ({n / total:.0%})" for n in values]
    sheet = bars(
        names,
        values,
        unit="posts",
        notes=notes,
        colors=[TYPE_COLORS.get(name, BLUE) for name in names],
    )
    return Figure(
        "reddit-types",
        "What kinds of posts there are",
        f"{total:,} kept posts by type; a crosspost has its parent's type.",
        "Bars of posts by type: " + ", ".join(f"{name} {n:,}" for name, n in top) + ".",
        saved(sheet),
        ("type", "posts"),
        top,
    )


FIGURES = (
    partial(funnel, name="reddit/posts"),
    post_types,
    scores,
    partial(dates, table="reddit/posts", column="created_utc", what="made", color=PURPLE),
    partial(funnel, name="reddit/comments"),
    partial(toxicity, table="reddit/posts", columns=("toxicity_title", "toxicity_body")),
    partial(toxicity, table="reddit/comments", columns=("toxicity_body",)),
    partial(cloud.words, table="reddit/posts", columns=("title", "body")),
)
