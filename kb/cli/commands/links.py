"""`kb links`: entities, and where the three sources speak of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER
from kb.cli.framework.options import pipeline as shipped

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Entities, and where videos, wiki and threads speak of them.")


@command(
    app,
    uses=(*CLUSTER, "pipeline"),
    again="Match every source anew, also those whose clean tables have not changed.",
    json="entities, with_page, links, mentions, sources",
    needs_data=True,
    checks=True,
    examples=[
        "kb links                                 what changed since the last time",
        "kb links --again                         everything anew",
        "kb query \"FROM links.links WHERE entity = 'Wolf' ORDER BY count DESC LIMIT 10\"",
    ],
)
def links(run: Run) -> Summary:
    """Make the entity tables: every keyword, its wiki page, and all that names it.

    Words of videos, pages, posts and comments are matched as for the pairs. links/ and
    release/links/ hold ids, counts and seconds, no text. A source whose clean files are the same is
    not read again.
    """
    made: Summary = shipped(run, "links").links(run)
    return made
