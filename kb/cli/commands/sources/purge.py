"""`kb purge`: remove content for good from every folder."""

from __future__ import annotations

from collections.abc import Callable
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


def _purge(run: Run, source: str, ids: Path | None, people: Path | None, plan: bool) -> Summary:
    room = pipeline(run, "purge")
    summary: Summary
    if not plan:
        summary = room.purge(run, source, ids, people)
        return summary
    summary = room.plan(run, source, ids, people)
    show_row(("folder", "what", "count"))
    for line in summary["lines"]:
        show_row((line["folder"], line["what"], line["count"]))
    return summary


def _reddit(
    run: Run,
    ids: Ids = None,
    authors: Annotated[
        Path | None,
        typer.Option(
            "--authors",
            metavar="FILE",
            help="Also remove all that these people posted or commented, and never collect more"
            " of it: a name or the address of a profile per line.",
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    return _purge(run, "reddit", ids, authors, plan)


def _youtube(
    run: Run,
    ids: Ids = None,
    channels: Annotated[
        Path | None,
        typer.Option(
            "--channels",
            metavar="FILE",
            help="Also remove all videos of these channels, and never collect more of them: an id"
            " or an address with /channel/ per line.",
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    return _purge(run, "youtube", ids, channels, plan)


def _by_ids(source: str) -> Callable[..., Summary]:
    def purge(run: Run, ids: Ids = None, plan: Plan = False) -> Summary:
        return _purge(run, source, ids, None, plan)

    return purge


_OWN: dict[str, Callable[..., Summary]] = {"reddit": _reddit, "youtube": _youtube}


def _add(source: str, about: str, *examples: str) -> None:
    declared = command(
        app,
        source,
        help=about,
        uses=CLUSTER,
        json="purged, known, unknown, unread, rows, scores",
        planned=("ids", "authors", "channels"),
        needs_data=True,
        examples=examples,
    )
    declared(_OWN.get(source) or _by_ids(source))


for _name, _source in SOURCES.items():
    _examples = _source.purge_examples or (f"kb purge {_name} --ids ids.txt",)
    _add(_name, _source.purge_help, *_examples)
