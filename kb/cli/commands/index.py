"""`kb index`: the local search index."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.cli.framework.command import command, group
from kb.core.verdict import Summary

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Build the local search index of all clean text.")


@command(
    app,
    needs_data=True,
    resumable=False,
    again="Rebuild the index of every source, even if its clean tables have not changed.",
    json="passages, indexed, sources",
    examples=[
        "kb index                                 what has changed since the last run",
        "kb index --again                         everything again",
    ],
)
def index(run: Run) -> Summary:
    """Build the index that `kb search` reads: transcripts, wiki sections, tables, posts, comments.

    A source whose clean files have not changed is skipped. index/<source>/ holds texts and is
    never released.
    """
    from kb.search.build import index

    return index(run)
