"""`kb reddit`: posts and comments of one subreddit, from the live API and from dumps."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.command_classes import DumpsCommand
from kb.cli.framework.options import CLUSTER, Dumps, Plan
from kb.cli.framework.source_commands import add_export, add_filter
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary

app = group("Collect posts and comments of a subreddit.")

Since = Annotated[
    str | None,
    typer.Option("--since", metavar="DATE", help="Only posts from this time on (UTC)."),
]
Until = Annotated[
    str | None,
    typer.Option("--until", metavar="DATE", help="Only posts before this time (UTC)."),
]


@command(
    app,
    uses=("wait",),
    limit="Stop after N more posts with their comments (exit code 3); the next run resumes.",
    again="Start a new round: read the listings again, back to where the last round began, and only"
    " new posts with their comments.",
    json="crawled, comments, posts, failed, pending, incomplete_posts, requests",
    checks=True,
    examples=[
        (
            "kb reddit crawl                          every listing of the profile's"
            " subreddit, with all comments"
        ),
        "kb reddit crawl --limit 100              100 posts with their comments",
        "kb reddit crawl --since 2026-01-01       only posts of this year",
    ],
)
def crawl(run: Run, since: Since = None, until: Until = None, plan: Plan = False) -> Summary:
    """Crawl posts and whole comment trees, as raw JSON.

    Archive dumps (`kb reddit import`) need no key. The live API needs REDDIT_CLIENT_ID,
    REDDIT_CLIENT_SECRET (empty for an installed app) and KB_CONTACT; since November 2025 Reddit
    gives keys only to apps that it has approved under its Responsible Builder Policy.
    User names are hashed before anything is written. Posts outside --since and --until are left
    out of the tables too (`outside` in the summary); a later crawl with another span, or none,
    reads them.
    """
    from kb.reddit.crawl.connector import crawl
    from kb.reddit.plan import plan_crawl

    begin, end = _span(since, until)
    if plan:
        return plan_crawl(run)
    return crawl(run, since=begin, until=end)


@command(
    app,
    name="import",
    uses=CLUSTER,
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Read dumps again that were imported before; without it they are skipped.",
    json="crawled, lines, bad_lines, truncated_files, foreign_files",
    checks=True,
    examples=[
        "kb reddit import RS_2024-01.zst RC_2024-01.zst       monthly dumps, all subreddits mixed",
        "kb reddit import Minecraft_submissions.zst           a file of one subreddit",
        "kb reddit import ~/dumps                             every dump in a folder",
    ],
)
def import_(
    run: Run,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Archive dumps as zstd, zst_blocks, gzip or plain NDJSON, recognized by their"
            " content, or folders of them.",
        ),
    ],
    since: Annotated[
        str | None,
        typer.Option(
            "--since",
            metavar="DATE",
            help="Only posts and comments from this time on (UTC).",
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            "--until", metavar="DATE", help="Only posts and comments before this time (UTC)."
        ),
    ] = None,
) -> Summary:
    """Import the subreddit's posts and comments from archive dumps. Sends nothing; needs no key.

    Folders are searched for dumps. The summary counts damaged lines, truncated files and files of
    a folder that are not dumps. After an interruption the same command resumes.
    """
    from kb.reddit.crawl.importer import import_dumps

    begin, end = _span(since, until)
    return import_dumps(run, files, since=begin, until=end)


add_filter(app, "reddit")
add_export(app, "reddit")


@command(
    app,
    uses=("workers", "wait"),
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Ask for every id again, or read the dumps again, even where all were answered.",
    json="posts, comments, missing, requests, bad_lines, truncated_files",
    planned=("ids", "dumps"),
    cls=DumpsCommand,
    examples=[
        (
            "kb reddit reconstruct --ids release/reddit --dumps RS_*.zst RC_*.zst"
            "    without key or network"
        ),
        "kb reddit reconstruct                                 the data root's own release",
        "kb reddit reconstruct --ids release/reddit            a release, posts and comments",
        "kb reddit reconstruct --ids posts-00000-of-00001.parquet --out full",
        (
            "kb reddit reconstruct --ids reddit.json --out full    MineDojo's published list:"
            " whole trees"
        ),
    ],
)
def reconstruct(
    run: Run,
    ids: Annotated[
        list[Path] | None,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="Full names or URLs one per line, CSV, a released Parquet file, MineDojo's"
            " reddit.json, or the folder of a release; may be repeated."
            " [default: release/reddit]",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Write the tables there. [default: export/reconstructed in the data root]",
        ),
    ] = None,
    dumps: Dumps = None,
    plan: Plan = False,
) -> Summary:
    """Restore full posts and comments from released ids, from dumps or with your own app's key.

    Asks for 100 ids per request. What can't be restored is listed in missing.parquet. Tables that
    are in --out already are added to; what was removed stays removed, even if an older dump has
    it. After an interruption the same command resumes.
    """
    from kb.reddit.plan import plan_rebuild
    from kb.reddit.restore.reconstruct import rebuild
    from kb.store.layout import Layout

    if plan:
        return plan_rebuild(run, ids or None, dumps or ())
    place = (out or Layout(run.root).reconstructed).absolute()
    return rebuild(run, ids or None, place, dumps=dumps or ())


def _span(since: str | None, until: str | None) -> tuple[datetime | None, datetime | None]:
    begin, end = _moment("--since", since), _moment("--until", until)
    if begin and end and begin >= end:
        raise SettingError(f"--since {since} is not earlier than --until {until}", hint="swap them")
    return begin, end


def _moment(name: str, text: str | None) -> datetime | None:
    if text is None:
        return None
    try:
        return clock.parse(text)
    except ValueError:
        raise SettingError(
            f"{name} is {text!r}, not a date",
            hint="write it like 2026-01-31 or 2026-01-31T12:00:00Z",
        ) from None
