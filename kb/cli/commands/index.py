"""`kb index`: one local index over everything that is clean."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.cli.framework.command import command, group

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("One local index over everything that is clean, for kb search.")


@command(
    app,
    needs_data=True,
    resumable=False,
    again="Index every source anew, also those whose clean tables have not changed.",
    json="passages, indexed, sources",
    examples=[
        "kb index                                 what changed since the last time",
        "kb index --again                         every source anew",
    ],
)
def index(run: Run) -> Summary:
    """Make the index that `kb search` reads: transcripts, wiki sections, tables, posts, comments.

    A source whose clean files are the same is left as it is. index/<source>/ holds texts of their
    authors and is never released; `kb query` is what looks at the rows themselves.
    """
    from kb.search.build import index

    return index(run)
