"""`kb youtube`: the pattern for every group. A command is a name, its options, examples,
and one call into its room.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import Part, Plan, parse_part, pipeline
from kb.cli.framework.source_commands import add_export, add_filter

if TYPE_CHECKING:
    from kb.core.context import Run
    from kb.core.verdict import Summary

app = group("Channels, videos and transcripts of YouTube.")


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
    again="Start a new round: list the channels' uploads once more and read only new videos.",
    json="crawled, channels, transcripts, failed, pending, missing, requests, units",
    checks=True,
    planned=("ids", "part"),
    examples=[
        (
            "kb youtube crawl --plan                  what is left costs: units, calls,"
            " hours, GB, days"
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
    only: Annotated[CrawlPhase | None, typer.Option("--only", help="Run one phase alone.")] = None,
    part: Part = None,
    ids: Annotated[
        Path | None,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="Video ids: lines, a download archive of yt-dlp, CSV, JSON (MineDojo's videos or"
            " pairs, CLIP4MC's), a released Parquet file or the folder of a release; skips"
            " discovery.",
        ),
    ] = None,
) -> Summary:
    """Crawl channels by keyword, their uploads, metadata and transcripts, as raw JSON.

    Needs YOUTUBE_API_KEY. Stops with exit code 3 when a quota is spent; the same command goes on.
    """
    which = parse_part(part)
    if plan:
        from kb.core.errors import SettingError
        from kb.youtube.connector.plan import plan as estimate

        if part and not ids:
            raise SettingError(
                "--part has no effect on --plan without --ids",
                hint="leave it out: the plan is of all that is left",
            )

        return estimate(run, ids=ids, part=which)
    summary: Summary = pipeline(run, "youtube").crawl(run, only.value if only else None, ids, which)
    return summary


@command(
    app,
    uses=("wait",),
    limit="Stop after N more videos (exit code 3); the next run resumes.",
    again="Ask for every video of the list once more instead of showing the last result.",
    json="there, changed, gone, by_year, requests, units",
    planned=("ids",),
    examples=[
        "kb youtube check --ids youtube_full.json --plan   units and days that it takes",
        "kb youtube check --ids release/youtube            a release: there, changed, gone by year",
    ],
)
def check(
    run: Run,
    ids: Annotated[
        Path,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="A published list: lines, a download archive of yt-dlp, CSV, JSON (MineDojo's"
            " videos or pairs, CLIP4MC's), a released Parquet file or the folder of a release.",
        ),
    ],
    plan: Annotated[
        bool, typer.Option("--plan", help="Print what it costs; send nothing.")
    ] = False,
) -> Summary:
    """Tell how much of a published list of videos is still there, has changed or is gone, by year.

    Needs YOUTUBE_API_KEY: a unit for 50 videos. Changed: title or duration differ from the list's.
    Only counts are kept. Stops with exit code 3 when the quota is spent; the same command goes on.
    """
    from kb.youtube.connector import check as room

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
    json="crawled, subtitles, playlists, files, known_files, left_out_by, null_columns",
    checks=True,
    examples=[
        "kb youtube import ~/Videos/minecraft          what yt-dlp wrote there",
        "kb youtube import disk1 disk2 && kb youtube filter",
    ],
)
def import_(
    run: Run,
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Folders that yt-dlp wrote to.")
    ],
) -> Summary:
    """Take videos and subtitles out of folders of yt-dlp. Sends nothing; needs no key.

    Reads *.info.json (videos, playlists, channels) and subtitles as .vtt, .srv3 and .json3, in all
    folders below. Files that were imported before are skipped; stopped, the same command goes on.
    Columns that files cannot tell stay null, and are named at the end. Without the game's label,
    which no file has, keywords decide the topic.
    """
    from kb.youtube.ytdlp.importer import import_folders, told

    summary = import_folders(run, folders)
    for line in told(summary):
        typer.echo(line)
    return summary


filter_ = add_filter(app, "youtube")
export = add_export(app, "youtube")
