"""The figures of the wiki, among them what its pages consist of."""

from __future__ import annotations

from functools import partial

from kb.core.profile import Profile
from kb.report import wikipage
from kb.report.charts import bars
from kb.report.data import ReportData
from kb.report.dates import dates
from kb.report.funnel import funnel
from kb.report.style import BLUE, GREEN, Figure, saved
from kb.report.toxicity import toxicity
from kb.report.wikipage import KINDS


def elements(data: ReportData, profile: Profile) -> Figure | None:
    """Elements of the wiki's pages by kind."""
    top = data.top("wiki/elements", "kind", 10)
    if not top:
        return None
    sheet = bars(
        [name for name, _ in top],
        [n for _, n in top],
        unit="elements",
        colors=[KINDS[name].color if name in KINDS else BLUE for name, _ in top],
    )
    total = sum(n for _, n in top)
    return Figure(
        "wiki-elements",
        "What is on the pages",
        f"{total:,} elements with a box, by kind.",
        "Bars of elements by kind: " + ", ".join(f"{name} {n:,}" for name, n in top) + ".",
        saved(sheet),
        ("kind", "elements"),
        top,
    )


FIGURES = (
    wikipage.page,
    partial(funnel, name="wiki/pages"),
    elements,
    partial(dates, table="wiki/pages", column="revision_timestamp", what="revised", color=GREEN),
    partial(toxicity, table="wiki/pages", columns=("toxicity",)),
)
