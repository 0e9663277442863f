"""`kb models`: the files of the toxicity model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.help import Group
from kb.core.verdict import Summary

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Download the toxicity model.")


@app.callback(cls=Group)
def models() -> None:
    """Download the toxicity model."""


@command(
    app,
    without=("data", "profile"),
    json="model, fetched, present, bytes, folder",
    examples=[
        "kb models fetch                the model of the paper, Detoxify `original`",
        "kb models fetch unbiased       another model; then set KB_TOXICITY_MODEL=unbiased",
    ],
)
def fetch(
    run: Run,
    name: Annotated[
        str,
        typer.Argument(
            metavar="[NAME]",
            help="original, unbiased, multilingual, original-small or unbiased-small.",
        ),
    ] = "original",
) -> Summary:
    """Download a published checkpoint with its configuration and vocabulary, and verify them.

    An interrupted download resumes. The files are kept in the user's cache, for all data roots.
    """
    from kb.annotate.fetch import fetch as room

    return room(run, name)
