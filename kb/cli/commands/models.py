"""`kb models`: the files of the toxicity model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.help import Group

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("The toxicity model's files.")


@app.callback(cls=Group)
def models() -> None:
    """The toxicity model's files."""


@command(
    app,
    without=("data", "profile"),
    json="model, fetched, present, bytes, folder",
    examples=[
        "kb models fetch                the model that the paper used, Detoxify `original`",
        "kb models fetch unbiased       another one; then set KB_TOXICITY_MODEL=unbiased",
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
    """Download the published checkpoint with its configuration and vocabulary, and verify it.

    Goes on where a download was cut off. The files are kept in the user's cache, for every data
    root.
    """
    from kb.annotate.fetch import fetch as room

    return room(run, name)
