"""`kb purge`: what was deleted at its source, or named, leaves every folder for good."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.command import command, group
from kb.cli.options import CLUSTER, pipeline

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Remove for good what was deleted at its source, or named.")

Ids = Annotated[
    Path | None,
    typer.Option(
        "--ids", metavar="FILE", help="Also remove these keys: one a line, or a Parquet file."
    ),
]


@command(
    app,
    uses=CLUSTER,
    needs_data=True,
    examples=["kb purge youtube", "kb purge youtube --ids gone.txt"],
)
def youtube(run: Run, ids: Ids = None) -> Summary:
    """Remove videos that vanished from YouTube, or are named, from every folder, and remember them."""
    return pipeline(run, "purge").purge(run, "youtube", ids)


@command(app, uses=CLUSTER, needs_data=True, examples=["kb purge wiki --ids pages.txt"])
def wiki(run: Run, ids: Ids = None) -> Summary:
    """Remove pages that the wiki deleted, or that are named, from every folder, and remember them.

    The file names pages by id, title or address, a line each, or is MineDojo's JSON. Names that nothing here bears
    are counted as unknown, and kept away from later crawls.
    """
    return pipeline(run, "purge").purge(run, "wiki", ids)


@command(
    app,
    uses=CLUSTER,
    needs_data=True,
    examples=["kb purge reddit", "kb purge reddit --ids requests.txt"],
)
def reddit(run: Run, ids: Ids = None) -> Summary:
    """Remove posts and comments that were deleted or removed, or are named, and remember them."""
    return pipeline(run, "purge").purge(run, "reddit", ids)
