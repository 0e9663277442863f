"""`kb restore`: for whoever has downloaded a release and nothing else."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.dumps import Dumps, DumpsCommand
from kb.cli.framework.options import Plan
from kb.core.sources import SPECS

if TYPE_CHECKING:
    from kb.cli.framework.options import Options
    from kb.core.verdict import Summary

app = group("The content of a downloaded release, with your own keys.")


# What can be brought back; of the other sources a release has everything.
_PARTS = (*(name for name, spec in SPECS.items() if spec.restored), "pairs")
RestorePart = StrEnum("RestorePart", _PARTS)  # type: ignore[misc]


@command(
    app,
    raw=True,
    uses=("workers", "wait"),
    limit="Stop after N more items of each source (exit code 3); the next run resumes.",
    again="Ask for everything once more, also what is in restored/ or was missing last time.",
    json="sources (the summary of each), requests, missing",
    planned=("folders", "dumps", "only"),
    cls=DumpsCommand,
    examples=[
        "kb restore .                             the release folder that you are in",
        "kb restore release --plan                what it would ask, of whom, with which key",
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
        RestorePart | None,
        typer.Option("--only", help="Bring back one part of it."),
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Bring back the content of downloaded releases: videos, transcripts, posts, comments, texts.

    Needs YOUTUBE_API_KEY for videos, and for posts and comments archive dumps (--dumps) or a key of
    Reddit.
    The folders are compared with SHA256SUMS first; the profile is theirs. Everything goes to
    restored/ in the data root, to be queried as restored.*; what could not be had is in
    restored.missing with the reason. Cut off, the same command goes on.
    """
    from dataclasses import replace

    from kb.core.pipeline import load, locate
    from kb.release.downloaded import find, profile_of

    releases = find(folders)
    own = profile_of(releases)
    if options.profile is None and own is not None:
        options = replace(options, profile=str(own))
    run = options.make_run()
    room = load(str(locate("restore")))
    way = room.plan if plan else room.restore
    summary: Summary = way(run, releases, dumps or (), only.value if only else None)
    return summary
