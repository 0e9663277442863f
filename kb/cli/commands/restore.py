"""`kb restore`: the content of a downloaded release."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.command_classes import DumpsCommand
from kb.cli.framework.options import Dumps, Options, Plan
from kb.core.config.pipeline import load, locate
from kb.core.sources import SOURCES
from kb.core.summary import Summary

app = group("Restore the content of a downloaded release with your own keys.")


# Parts that can be restored; releases of the other sources are complete.
_PARTS = (*(name for name, source in SOURCES.items() if source.restored), "pairs")
RestorePart = StrEnum("RestorePart", _PARTS)  # type: ignore[misc]


@command(
    app,
    raw=True,
    uses=("workers", "wait"),
    limit="Stop after N more items of each source (exit code 3); the next run resumes.",
    again="Ask for everything again, including what is in restored/ or was missing last time.",
    json="sources (the summary of each), requests, missing",
    planned=("folders", "dumps", "only"),
    cls=DumpsCommand,
    examples=[
        "kb restore .                             the release in the current folder",
        "kb restore release --plan                requests by service, and the keys they need",
        ("kb restore youtube reddit --dumps RS_*.zst RC_*.zst    posts and comments without a key"),
        "kb restore . --only youtube --limit 100  100 videos now, the rest with the next run",
    ],
)
def restore(
    options: Options,
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER...", help="Release folders, or a folder that holds several of them."
        ),
    ],
    dumps: Dumps = None,
    only: Annotated[
        RestorePart | None, typer.Option("--only", help="Restore only this part.")
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Restore the content of downloaded releases: videos, transcripts, posts, comments, texts.

    Videos need YOUTUBE_API_KEY; posts and comments need archive dumps (--dumps) or a Reddit key.
    The folders are first compared with their SHA256SUMS, and their profile is used. Everything is
    written to restored/ in the data root and can be queried as restored.*; restored.missing lists
    what could not be restored, with the reason. After an interruption the same command resumes.
    """
    from kb.release.folders import find, profile_of

    releases = find(folders)
    own = profile_of(releases)
    if options.profile is None and own is not None:
        options = replace(options, profile=str(own))
    run = options.make_run()
    room = load(str(locate("restore")))
    step = room.plan if plan else room.restore
    summary: Summary = step(run, releases, dumps or (), only.value if only else None)
    return summary
