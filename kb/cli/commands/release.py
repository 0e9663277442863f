"""`kb release`: check and describe release/; `kb release publish` uploads it."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.messages import show, with_options
from kb.cli.framework.options import Options, pipeline
from kb.core.errors import KbError, ReleaseRefused
from kb.core.summary import Summary

if TYPE_CHECKING:
    from kb.core.context import Run

app = group("Check, describe and publish release/.")
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="SOURCE",
        help="Only this folder (youtube, wiki, reddit, pairs, links); may be repeated.",
    ),
]


class Target(StrEnum):
    """Services that take a release."""

    sandbox = "zenodo-sandbox"
    zenodo = "zenodo"


@command(
    app,
    main=True,
    uses=("pipeline",),
    json="folders, rows, bytes, sources, and problems if it is refused",
    needs_data=True,
    examples=[
        (
            "kb release                               check every folder,"
            " then write cards, metadata and checksums"
        ),
        "kb release --only links                  only one folder",
        "kb release publish --to zenodo-sandbox   a draft of each folder, for review",
    ],
)
def release(run: Run, only: Only = None) -> Summary:
    """Check the exports, and add card, datasheet, metadata, sample and checksums to each folder.

    Every problem that prevents publishing is listed on a line, and nothing is written (exit code
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
            "kb release publish --to zenodo --publish           publish the uploaded drafts"
            " (can't be undone)"
        ),
    ],
)
def publish(
    options: Options,
    to: Annotated[Target, typer.Option("--to", help="The service that takes the deposits.")],
    publish: Annotated[
        bool, typer.Option("--publish", help="Publish the drafts. This can't be undone.")
    ] = False,
    only: Only = None,
) -> Summary:
    """Upload each folder of release/ as a deposit, a draft until --publish makes it public.

    An interrupted upload resumes. A folder that was published before and has changed becomes a new
    version of its record.
    """
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
            show("  ".join(str(fact) for fact in facts if fact))


def _listed(run: Run, name: str, *given: object) -> Summary:
    """Call the pipeline; the reasons of a refusal go to stderr, one line each."""
    try:
        summary: Summary = getattr(pipeline(run, "release"), name)(run, *given)
        return summary
    except ReleaseRefused as error:
        for line in getattr(error, "problems", []):
            show(with_options(line), err=True)
        raise
