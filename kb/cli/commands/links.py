"""`kb links`: entities, and where each source mentions them."""

from __future__ import annotations

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.context import Run
from kb.core.summary import Summary

app = group("Find which videos, wiki pages and threads mention which entities.")


@command(
    app,
    uses=(*CLUSTER, "pipeline"),
    again="Match every source again, even if its clean tables have not changed.",
    json="entities, with_page, links, mentions, sources",
    needs_data=True,
    checks=True,
    examples=[
        "kb links                                 what has changed since the last run",
        "kb links --again                         everything again",
        "kb query \"FROM links.links WHERE entity = 'Wolf' ORDER BY count DESC LIMIT 10\"",
    ],
)
def links(run: Run) -> Summary:
    """Make the entity tables: every keyword, its wiki page, and where it is mentioned.

    Videos, pages, posts and comments are matched by the same rules as pairs. links/ and
    release/links/ hold ids, counts and seconds, but no text. A source whose clean files have not
    changed is skipped.
    """
    summary: Summary = pipeline(run, "links").links(run)
    return summary
