"""`kb youtube`: channels, videos and transcripts.

The pattern for every group: a command is a name, options, examples and one call into its room.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import Part, Plan, parse_part, pipeline
from kb.cli.framework.source_commands import add_export, add_filter
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary

app = group("Collect videos and transcripts from YouTube.")


class CrawlPhase(StrEnum):
    """Phases of a crawl, in order."""

    channels = "channels"
    uploads = "uploads"
    metadata = "metadata"
    transcripts = "transcripts"


@command(
    app,
    uses=("workers", "wait", "pipeline"),
    limit="Stop after N more videos, each through every phase (exit code 3); the next run resumes.",
    again="Start a new round: list the channels' uploads again, and read only new videos.",
    json="crawled, channels, transcripts, failed, pending, missing, requests, units",
    checks=True,
    planned=("ids", "part"),
    examples=[
        (
            "kb youtube crawl --plan                  what is left, in units, calls,"
            " hours, GB and days"
        ),
        "kb youtube crawl --limit 100             100 videos through every phase",
        "kb youtube crawl --only metadata --wait  one phase, sleeping through quota resets",
        "kb youtube crawl --ids videos.parquet    known videos, no discovery",
        "kb youtube crawl --part 1/4              the first of four machines",
    ],
)
def crawl(
    run: Run,
    plan: Plan = False,
    only: Annotated[CrawlPhase | None, typer.Option("--only", help="Run only this phase.")] = None,
    part: Part = None,
    ids: Annotated[
        Path | None,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="Crawl these video ids instead of searching: lines, yt-dlp's download archive,"
            " CSV, JSON (MineDojo's videos or pairs, CLIP4MC's), a released Parquet file or the"
            " folder of a release.",
        ),
    ] = None,
) -> Summary:
    """Crawl channels by keyword, their uploads, metadata and transcripts, as raw JSON.

    Needs YOUTUBE_API_KEY. Stops with exit code 3 when a quota is spent; the same command resumes.
    """
    which = parse_part(part)
    if plan:
        from kb.youtube.plan import plan as estimate

        if part and not ids:
            raise SettingError(
                "--part has no effect on --plan without --ids",
                hint="--plan always covers all remaining work; drop --part",
            )

        return estimate(run, ids=ids, part=which)
    summary: Summary = pipeline(run, "youtube").crawl(run, only.value if only else None, ids, which)
    return summary


@command(
    app,
    uses=("wait",),
    limit="Stop after N more videos (exit code 3); the next run resumes.",
    again="Check every video of the list again instead of showing the last result.",
    json="there, changed, gone, by_year, requests, units",
    planned=("ids",),
    examples=[
        "kb youtube check --ids youtube_full.json --plan   what it costs in units and days",
        "kb youtube check --ids release/youtube            available, changed and gone",
    ],
)
def check(
    run: Run,
    ids: Annotated[
        Path,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="A published list: lines, yt-dlp's download archive, CSV, JSON (MineDojo's videos"
            " or pairs, CLIP4MC's), a released Parquet file or the folder of a release.",
        ),
    ],
    plan: Annotated[
        bool, typer.Option("--plan", help="Print what it costs; send nothing.")
    ] = False,
) -> Summary:
    """Count how many videos of a published list are available, changed or gone, by year.

    Needs YOUTUBE_API_KEY: one unit for 50 videos. A video counts as changed if its title or
    duration differs from the list's. Only counts are kept. Stops with exit code 3 when the quota is
    spent; the same command resumes.
    """
    from kb.youtube.crawl import video_list_check as room

    if plan:
        return room.plan(run, ids)
    summary = room.check(run, ids)
    for line in room.lines(summary):
        typer.echo(line)
    return summary


@command(
    app,
    name="import",
    limit="Stop after N more files (exit code 3); the next run resumes.",
    json="crawled, subtitles, playlists, files, known_files, left_out_by, left_out_files,"
    " null_columns",
    checks=True,
    examples=[
        "kb youtube import ~/Videos/minecraft          files that yt-dlp wrote there",
        "kb youtube import disk1 disk2 && kb youtube filter",
    ],
)
def import_(
    run: Run,
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders that yt-dlp wrote to.")
    ],
) -> Summary:
    """Import videos and subtitles from yt-dlp's folders. Sends nothing; needs no key.

    Reads *.info.json (videos, playlists, channels) and subtitles as .vtt, .srv3 and .json3,
    including subfolders. Files that were imported before are skipped; after an interruption the
    same command resumes. Columns that the files don't contain stay null and are listed at the end.
    The files lack YouTube's game label, so keywords alone decide the topic.
    """
    from kb.youtube.ytdlp.importer import import_folders, unfilled_columns

    summary = import_folders(run, folders)
    for line in unfilled_columns(summary):
        typer.echo(line)
    return summary


add_filter(app, "youtube")
add_export(app, "youtube")
