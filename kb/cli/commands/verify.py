"""`kb verify`: find damaged, missing and foreign files, and repair them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, with_options
from kb.cli.framework.options import Options, pipeline
from kb.core import terminal
from kb.core.errors import DamagedData, UsageError
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.verify.findings import Findings

app = group("Find damaged, missing and foreign files in a data root or release.")


@command(
    app,
    raw=True,
    resumable=False,
    json="files_whole, files_damaged, files_missing, files_foreign, kinds, found",
    examples=[
        "kb verify                       the data root",
        "kb verify release/              a download, compared with its checksums",
        "kb verify --repair              rebuild or fetch again what is damaged or missing",
    ],
)
def verify(
    options: Options,
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FOLDER]",
            help="A data root, a release folder, or a folder of releases. [default: the data root]",
        ),
    ] = None,
    repair: Annotated[
        bool,
        typer.Option(
            "--repair",
            help="Move damaged files away, and fetch or rebuild them; foreign files stay.",
        ),
    ] = False,
) -> Summary:
    """Read every byte, and list files that are damaged, missing or foreign.

    Prints one line per kind of files, then one per problem with what to do about it. The exit code
    is 1 if there is a problem. Nothing is changed without --repair.
    """
    from kb.artifacts.table_catalog import existing, is_root

    if folder is not None:
        options = replace(options, data=existing(folder))
    run = options.make_run(needs="profile" if repair else "root", exists=True)
    place = run.root
    repairable = is_root(place)
    if repair and not repairable:
        raise UsageError(
            f"{place} is not a data root: a download can't be rebuilt from raw data",
            hint="download damaged files again, into the same folder",
        )
    room = pipeline(run, "verify")
    report: Findings
    repaired: list[str]
    report, repaired = room.repair(run) if repair else (room.verify(run, place), [])
    run.progress.close()
    for line in terminal.table(list(report.table())):
        typer.echo(line)
    for one in report.entries:
        show(with_options(f"{one.state}: {one.path}: {one.what}; {one.advice}"))
    for line in repaired:
        show(with_options(f"repair: {line}"))
    summary = Summary(command="verify", **report.summary(place), repaired=repaired)
    if report.entries:
        counts = ", ".join(
            f"{files:,} {state}"
            for state in ("damaged", "missing", "foreign")
            if (files := report.total(state)[0])
        )
        hint = "`kb verify --repair` repairs what it can" if repairable and not repair else ""
        error = DamagedData(f"{place} has problems: {counts}", hint=hint)
        error.summary = summary
        raise error
    return summary
