"""`kb verify`: every byte of a data root or a release, and what is not as it was written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import pipeline

if TYPE_CHECKING:
    from kb.cli.framework.options import Options
    from kb.core.verdict import Summary
    from kb.verify.found import Look

app = group("Every byte of a data root or release: whole, damaged, missing, foreign.")


@command(
    app,
    raw=True,
    resumable=False,
    json="files_whole, files_damaged, files_missing, files_foreign, kinds, found",
    examples=[
        "kb verify                       the data root",
        "kb verify release/              a download, against its checksums",
        "kb verify --repair              make and ask again for what is not whole",
    ],
)
def verify(
    options: Options,
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FOLDER]",
            help="A data root, a release folder, or a folder of these. [default: the data root]",
        ),
    ] = None,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair",
            help="Set aside what is damaged, fetch or make it again; foreign files stay.",
        ),
    ] = False,
) -> Summary:
    """Read every byte, and tell what is whole, damaged, missing or foreign.

    One line a kind of files, then one for each that is not whole, with what to do. Exit code 1
    where there is such a file. Nothing is changed without --repair.
    """
    from kb.artifacts.catalog import existing, is_root
    from kb.core.errors import DamagedData, UsageError
    from kb.core.verdict import Summary

    if folder is not None:
        options = replace(options, data=existing(folder))
    run = options.make_run(needs="profile" if repair else "root", exists=True)
    place = run.root
    if repair and not is_root(place):
        raise UsageError(
            f"{place} is not a data root: a download can't be rebuilt from raw data",
            hint="download again what is damaged, into the same folder",
        )
    room = pipeline(run, "verify")
    look: Look
    done: list[str]
    look, done = room.mended(run) if repair else (room.verify(run, place), [])
    run.progress.close()
    _print(look, done)
    summary = Summary(command="verify", **look.summary(place), repaired=done)
    if look.found:
        counts = ", ".join(
            f"{files:,} {state}"
            for state in ("damaged", "missing", "foreign")
            if (files := look.total(state)[0])
        )
        way = "" if repair or not is_root(place) else "`kb verify --repair` repairs what it can"
        error = DamagedData(f"{place} is not whole: {counts}", hint=way)
        error.summary = summary
        raise error
    return summary


def _print(look: Look, done: list[str]) -> None:
    from kb.cli.framework.as_typed import as_typed
    from kb.core import terminal

    rows = list(look.table())
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        first, *rest = (
            cell.ljust(width) if number == 0 else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        typer.echo("  ".join([first, *rest]).rstrip())
    for one in look.found:
        line = f"{one.state}: {one.path}: {one.what}; {one.advice}"
        typer.echo(terminal.one_line(as_typed(line)))
    for line in done:
        typer.echo(terminal.one_line(as_typed(f"repair: {line}")))
