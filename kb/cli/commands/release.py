"""`kb release`: checks, metadata and checksums around release/;
`kb release publish` deposits it.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.as_typed import as_typed
from kb.cli.framework.command import command, group
from kb.cli.framework.options import Options, pipeline

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Checks, metadata and checksums around release/; publish.")
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="SOURCE",
        help="This folder alone (youtube, wiki, reddit, pairs, links); may be repeated.",
    ),
]


class Target(StrEnum):
    """Where a release can go."""

    sandbox = "zenodo-sandbox"
    zenodo = "zenodo"


@command(
    app,
    main=True,
    uses=("pipeline",),
    json="folders, rows, bytes, sources, and problems where it is refused",
    needs_data=True,
    examples=[
        (
            "kb release                               check every folder,"
            " then write all that surrounds the data"
        ),
        "kb release --only links                  one folder alone",
        "kb release publish --to zenodo-sandbox   a draft of each folder, to look at",
    ],
)
def release(run: Run, only: Only = None) -> Summary:
    """Check what the exports wrote and make each folder whole: card, datasheet, metadata, sample,
    checksums.

    Whatever speaks against publishing is listed at once, one line each, and nothing is made (exit
    1).
    """
    return _listed(run, "release", only or [])


@command(
    app,
    raw=True,
    uses=("wait", "pipeline"),
    json="deposits, drafts, published, unchanged, uploaded, sources",
    examples=[
        "kb release publish --to zenodo-sandbox             upload drafts to the sandbox",
        "kb release publish --to zenodo                     upload drafts",
        (
            "kb release publish --to zenodo --publish           publish the uploaded drafts:"
            " can't be undone"
        ),
    ],
)
def publish(
    options: Options,
    to: Annotated[Target, typer.Option("--to", help="The service that takes the deposits.")],
    publish: Annotated[
        bool, typer.Option("--publish", help="Publish the drafts: can't be undone.")
    ] = False,
    only: Only = None,
) -> Summary:
    """Upload each folder of release/ as one deposit: a draft, until --publish makes it public.

    An interrupted upload goes on where it stopped. A folder that was published before and has
    changed becomes a new version of its record.
    """
    from kb.core import terminal
    from kb.core.errors import KbError

    run = options.make_run()
    done: dict[str, Any] = {}
    try:
        summary = _listed(run, "publish", str(to), publish, only or [])
        done = summary
        return summary
    except KbError as error:
        done = error.summary or {}
        raise
    finally:
        run.progress.close()
        for source, one in done.get("sources", {}).items() if not options.json else ():
            facts = (source, one["state"], one["id"], one["doi"], one["page"])
            typer.echo(terminal.one_line("  ".join(str(what) for what in facts if what)))


def _listed(run: Run, name: str, *given: object) -> Summary:
    """Call the pipeline; a refusal's reasons go to stderr, one line each."""
    from kb.core import terminal
    from kb.core.errors import ReleaseRefused

    try:
        summary: Summary = getattr(pipeline(run, "release"), name)(run, *given)
        return summary
    except ReleaseRefused as error:
        for line in getattr(error, "problems", []):
            typer.echo(terminal.one_line(as_typed(line)), err=True)
        raise
