"""`kb label`: people judge a sample in Label Studio."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Let people judge a sample in Label Studio.")


@app.callback()
def label() -> None:
    """Let people judge a sample in Label Studio."""


class Judged(StrEnum):
    """What can be judged."""

    pairs = "pairs"


@command(
    app,
    json="items, strata, out_of, hours, path",
    needs_data=True,
    examples=[
        "kb label export pairs                        400 pairs, to label-pairs/",
        "kb label export pairs --sample 50 --seed 1 --out trial   50 other pairs, to trial/",
    ],
)
def export(
    run: Run,
    what: Annotated[Judged, typer.Argument(help="What to judge.")],
    sample: Annotated[
        int, typer.Option("--sample", min=1, metavar="N", help="Judge at most N of them.")
    ] = 400,
    seed: Annotated[
        int, typer.Option("--seed", min=0, metavar="N", help="Another seed draws another sample.")
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Write there. [default: label-WHAT]"),
    ] = None,
) -> Summary:
    """Write a sample as a project for Label Studio: config.xml, tasks.json and README.md.

    The sample is stratified (pairs: by kind of keyword and timing), and each item carries the
    weight that it stands for. A larger sample of the same seed begins with the smaller one. Only
    reads. --data may be a data root or a downloaded release; a release holds no texts, so that the
    question about the text is left out.
    """
    from kb.labels import questions
    from kb.labels.export import export

    labeling = {Judged.pairs: questions.PAIRS}[what]
    return export(run, labeling, sample, seed, out or Path(f"label-{what}"))
