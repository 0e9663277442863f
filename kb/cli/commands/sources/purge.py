"""`kb purge`: remove content for good from every folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_row
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.verdict import Summary

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Remove content that was deleted at its source or that a file names.")

Ids = Annotated[
    Path | None,
    typer.Option(
        "--ids",
        metavar="FILE",
        help="Also remove these ids: one per line, CSV, JSON or a Parquet file.",
    ),
]
Plan = Annotated[
    bool,
    typer.Option(
        "--plan", help="Count what would be removed, by table and folder; change nothing."
    ),
]


def _add(source: str, about: str, *examples: str) -> None:
    def purge(run: Run, ids: Ids = None, plan: Plan = False) -> Summary:
        room = pipeline(run, "purge")
        summary: Summary
        if not plan:
            summary = room.purge(run, source, ids)
            return summary
        summary = room.plan(run, source, ids)
        show_row(("folder", "what", "count"))
        for line in summary["lines"]:
            show_row((line["folder"], line["what"], line["count"]))
        return summary

    purge.__doc__ = about
    command(
        app,
        name=source,
        uses=CLUSTER,
        json="purged, unknown, rows, scores",
        planned=("ids",),
        needs_data=True,
        examples=examples,
    )(purge)


_add(
    "youtube",
    "Remove videos that are gone from YouTube or are named, and never collect them again.",
    "kb purge youtube",
    "kb purge youtube --ids gone.txt",
    "kb purge youtube --plan",
)
_add(
    "wiki",
    """Remove pages that the wiki deleted or that are named, and never collect them again.

    The file names pages by id, title or URL, one per line, or is MineDojo's JSON. Names that
    match nothing are counted as unknown, and are skipped by later crawls.
    """,
    "kb purge wiki --ids pages.txt",
)
_add(
    "reddit",
    "Remove posts and comments that were deleted, removed or named, and never collect them again.",
    "kb purge reddit",
    "kb purge reddit --ids requests.txt",
)
