"""Figures of wiki pages, in the order of the report."""

from functools import partial

from kb.look.charts import GREEN
from kb.report.figures import dates, funnel, toxicity, values
from kb.wiki.page_figure import KINDS, pages

_PAGES = "wiki/pages"
FIGURES = (
    pages,
    partial(funnel, name=_PAGES),
    partial(
        values,
        table="wiki/elements",
        column="kind",
        name="wiki-elements",
        title="What is on the pages",
        caption="{total} elements, by kind; one that is folded has no box.",
        head=("kind", "elements"),
        colors={kind: look.color for kind, look in KINDS.items()},
        shares=False,
    ),
    partial(dates, table=_PAGES, column="revision_timestamp", what="revised", color=GREEN),
    partial(toxicity, table=_PAGES, columns=("toxicity",)),
)
