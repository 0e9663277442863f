"""What the wiki's pages consist of."""

from __future__ import annotations

from kb.core.profile import Profile
from kb.report.charts import bars
from kb.report.data import ReportData
from kb.report.style import BLUE, Figure, saved
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
