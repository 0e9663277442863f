"""`kb purge`: what was deleted at its source, or named, leaves every folder for good."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.source_spec import CommandHelp
from kb.core.sources import SPECS

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Remove for good what was deleted at its source, or named.")

Ids = Annotated[
    Path | None,
    typer.Option(
        "--ids",
        metavar="FILE",
        help="Also remove these keys: one a line, CSV, JSON or a Parquet file.",
    ),
]

Plan = Annotated[
    bool,
    typer.Option("--plan", help="Count what would go, by table and folder; change nothing."),
]


def _purge(run: Run, source: str, ids: Path | None, plan: bool) -> Summary:
    if not plan:
        summary: Summary = pipeline(run, "purge").purge(run, source, ids)
        return summary
    from kb.core import terminal

    counts: Summary = pipeline(run, "purge").plan(run, source, ids)
    typer.echo("folder\twhat\tcount")
    for line in counts["lines"]:
        cells = line["folder"], line["what"], line["count"]
        typer.echo("\t".join(terminal.one_line(str(cell)) for cell in cells))
    return counts


def _add(source: str, about: str, *examples: str) -> None:
    def purge(run: Run, ids: Ids = None, plan: Plan = False) -> Summary:
        return _purge(run, source, ids, plan)

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


for _name, _spec in SPECS.items():
    _text = _spec.purge_help or CommandHelp("Remove what is named, everywhere, and remember it.")
    _add(_name, _text.about, *(_text.examples or (f"kb purge {_name} --ids ids.txt",)))
