"""`kb purge`: remove content for good from every folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show_row
from kb.cli.framework.options import CLUSTER, pipeline
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.summary import Summary

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
    @command(
        app,
        source,
        help=about,
        uses=CLUSTER,
        json="purged, known, unknown, unread, rows, scores",
        planned=("ids",),
        needs_data=True,
        examples=examples,
    )
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


for _name, _source in SOURCES.items():
    _examples = _source.purge_examples or (f"kb purge {_name} --ids ids.txt",)
    _add(_name, _source.purge_help, *_examples)
