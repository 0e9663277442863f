"""`kb youtube`, `kb wiki` and `kb reddit`: crawl, import, filter and export.

The pattern for every group: a command is a name, options, examples and one call into its room.
"""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from kb.cli.framework.command import DumpsCommand, command, group
from kb.cli.framework.messages import show, show_list
from kb.cli.framework.options import (
    CLUSTER,
    Dumps,
    Options,
    Part,
    Plan,
    parse_part,
    parse_span,
)
from kb.cli.framework.source_commands import add_export, add_filter
from kb.core.config.pipeline import recipe_of
from kb.core.context import Run
from kb.core.errors import SettingError
from kb.core.summary import Summary

youtube_app = group("Collect videos and transcripts from YouTube.")


class CrawlPhase(StrEnum):
    """Phases of a crawl, in order."""

    channels = "channels"
    playlists = "playlists"
    uploads = "uploads"
    metadata = "metadata"
    transcripts = "transcripts"


@command(
    youtube_app,
    "crawl",
    uses=("workers", "wait"),
    limit="Stop after N more videos, each through every phase (exit code 3); the next run resumes.",
    again="Start a new round: list the channels' uploads again, and read only new videos.",
    json="crawled, channels, playlists, transcripts, failed, pending, missing, requests, units",
    checks=True,
    planned=("ids", "part"),
    data="makes",
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
def youtube_crawl(
    run: Run,
    plan: Plan = False,
    only: Annotated[CrawlPhase | None, typer.Option("--only", help="Run only this phase.")] = None,
    part: Part = None,
    ids: Annotated[
        Path | None,
        typer.Option(
            "--ids",
            metavar="FILE|FOLDER",
            help="Crawl these videos, and those of these playlists, instead of searching: lines,"
            " yt-dlp's download archive, CSV, JSON (MineDojo's videos or pairs, CLIP4MC's), a"
            " released Parquet file or the folder of a release.",
        ),
    ] = None,
) -> Summary:
    """Crawl channels and playlists by keyword, their videos' metadata and transcripts, as raw JSON.

    Needs YOUTUBE_API_KEY. Stops with exit code 3 when a quota is spent, and with 4 when somebody
    has to act, as for a captcha; the same command resumes.
    """
    which = parse_part(part)
    if plan:
        from kb.youtube.plan import plan as estimate

        if part and not ids:
            raise SettingError(
                "--part has no effect on --plan without --ids",
                hint="--plan always covers all remaining work; drop --part",
            )
        _replay_unread_answers(run, "youtube")
        return estimate(run, ids=ids, part=which)
    from kb.cli.commands.doctor import warn_of_space

    warn_of_space(run, "youtube")
    crawl = recipe_of(run.profile, "youtube").defined("crawl")
    summary: Summary = crawl(run, only.value if only else None, ids, which)
    return summary


@command(
    youtube_app,
    name="import",
    limit="Stop after N more files (exit code 3); the next run resumes.",
    json="crawled, subtitles, playlists, own_transcripts, unknown_videos, files, known_files,"
    " left_out_by, left_out_files, other_languages, other_language_files,"
    " word_times_dropped, word_times_dropped_files, null_columns",
    checks=True,
    data="makes",
    examples=[
        "kb youtube import ~/Videos/minecraft          files that yt-dlp wrote there",
        "kb youtube import disk1 disk2 && kb youtube filter",
        "kb youtube import --own-transcripts whisper   what Whisper wrote: ID.json, TITLE [ID].srt",
    ],
)
def youtube_import(
    run: Run,
    folders: Annotated[
        list[Path] | None, typer.Argument(metavar="[DIR]...", help="Folders that yt-dlp wrote to.")
    ] = None,
    own_transcripts: Annotated[
        list[Path] | None,
        typer.Option(
            "--own-transcripts",
            metavar="DIR",
            help="Transcripts of your own speech recognition: JSON of Whisper and of ten other"
            " programs, .srt or .vtt, named by video as ID.json, TITLE [ID].srt or ID/…; may be"
            " repeated.",
        ),
    ] = None,
) -> Summary:
    """Import videos and subtitles from yt-dlp's folders. Sends nothing; needs no key.

    Reads *.info.json (videos, playlists, channels) and subtitles as .vtt, .srv3, .json3 and .srt,
    including subfolders. Own transcripts are used where YouTube has none (`own_transcripts` in
    [youtube] of the profile), in the profile's language where they name none. Files that were
    imported before are skipped; after an interruption the same command resumes. Columns that the
    files don't contain stay null and are listed at the end. The files lack YouTube's game label, so
    keywords alone decide the topic.
    """
    from kb.reddit.dumps.find_dumps import holds_dump
    from kb.youtube.ytdlp.importer import import_folders, unfilled_columns

    given = [*(folders or ()), *(own_transcripts or ())]
    from kb.cli.framework.failed_import import importing

    with importing(run, given, "reddit", partial(holds_dump, root=run.root)):
        summary = import_folders(run, folders or (), own_transcripts or ())
    for line in unfilled_columns(summary):
        show(line)
    return summary


add_filter(youtube_app, "youtube")
add_export(youtube_app, "youtube")


@command(
    youtube_app,
    "missing-transcripts",
    raw=True,
    json="missing_transcripts, path",
    data="reads",
    examples=[
        "kb youtube missing-transcripts --out todo.txt              most viewed first",
        "kb youtube missing-transcripts | head -9 | yt-dlp -x -a -  their sound, for Whisper",
    ],
)
def missing_transcripts(
    options: Options,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write to FILE. [default: stdout]")
    ] = None,
) -> None:
    """List videos that pass every other stage but have no transcript, most viewed first.

    One id a line, for speech recognition of your own; `kb youtube import --own-transcripts DIR`
    takes its transcripts. Sends nothing.
    """
    from kb.artifacts import freshness
    from kb.youtube.status import missing_transcripts as listed

    run = options.make_run()
    ids = listed(run.root)
    if freshness.reasons(run, "clean/youtube"):
        run.progress.say("the tables are out of date; run `kb youtube filter` for a newer list")
    summary = Summary(command="youtube missing-transcripts", missing_transcripts=len(ids))
    show_list("".join(f"{item_id}\n" for item_id in ids), out, summary, options.json)


wiki_app = group("Collect wiki pages: screenshots, elements with boxes, tables and images.")


@command(
    wiki_app,
    "crawl",
    uses=("workers", "wait"),
    limit="Stop after N more pages (exit code 3); the next run resumes.",
    again="Start a new round: list the wiki again, and render only new pages and revisions.",
    json="crawled, images, failed, pending, robots, gone, unread_facts, requests",
    planned=("titles", "workers"),
    checks=True,
    data="makes",
    examples=[
        "kb wiki crawl --plan                     what is left and how long it takes",
        "kb wiki crawl --limit 100                100 pages, then exit code 3",
        "kb wiki crawl --again --workers 2        what has changed, with two browsers",
        "kb wiki crawl --titles titles.txt        named pages, no discovery",
    ],
)
def wiki_crawl(
    run: Run,
    titles: Annotated[
        Path | None,
        typer.Option(
            "--titles",
            metavar="FILE|FOLDER",
            help="Crawl these page titles instead of listing the wiki: lines, CSV, JSON (MineDojo's"
            " or the API's allpages), a dump's list of all titles, a released Parquet file, or the"
            " folder of a release or of wiki_full.",
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Render every content page in headless Chromium, and keep what a reader sees.

    Needs KB_CONTACT, Chromium and chromedriver. A second crawl (--again) renders only what has
    changed. Pages and images follow robots.txt, and every request its crawl-delay. API requests
    follow MediaWiki's etiquette (a contact, maxlag, Retry-After), even where robots.txt closes the
    API's folder to all crawlers; a rule that names `lorecrawl` is obeyed there too.
    """
    if plan:
        from kb.wiki.crawl.connector import plan_crawl

        _replay_unread_answers(run, "wiki")
        return plan_crawl(run, titles)
    from kb.cli.commands.doctor import warn_of_space

    warn_of_space(run, "wiki")
    summary: Summary = recipe_of(run.profile, "wiki").defined("crawl")(run, titles)
    return summary


add_filter(wiki_app, "wiki", "captured pages")
add_export(
    wiki_app,
    "wiki",
    goes="Parquet and tar shards go",
    tables="the released tables with their images",
)


reddit_app = group("Collect posts and comments of a subreddit.")


def _date(option: str, help: str) -> Any:
    return typer.Option(option, metavar="DATE", help=help)


@command(
    reddit_app,
    "crawl",
    uses=("wait",),
    limit="Stop after N more posts with their comments (exit code 3); the next run resumes.",
    again="Start a new round: read the listings again, back to where the last round began, and only"
    " new posts with their comments.",
    json="crawled, comments, posts, failed, pending, incomplete_posts, requests",
    checks=True,
    data="makes",
    examples=[
        (
            "kb reddit crawl                          every listing of the profile's"
            " subreddit, with all comments"
        ),
        "kb reddit crawl --limit 100              100 posts with their comments",
        "kb reddit crawl --since 2026-01-01       only posts of this year",
    ],
)
def reddit_crawl(
    run: Run,
    since: Annotated[
        str | None, _date("--since", help="Only posts from this time on (UTC).")
    ] = None,
    until: Annotated[
        str | None, _date("--until", help="Only posts before this time (UTC).")
    ] = None,
    plan: Plan = False,
) -> Summary:
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

    begin, end = parse_span(since, until)
    if plan:
        _replay_unread_answers(run, "reddit")
        return plan_crawl(run)
    from kb.cli.commands.doctor import warn_of_space

    warn_of_space(run, "reddit")
    return crawl(run, since=begin, until=end)


@command(
    reddit_app,
    name="import",
    uses=CLUSTER,
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Read dumps again that were imported before; without it they are skipped.",
    json="crawled, lines, bad_lines, truncated_files, foreign_files",
    checks=True,
    data="makes",
    examples=[
        "kb reddit import RS_2024-01.zst RC_2024-01.zst       monthly dumps, all subreddits mixed",
        "kb reddit import Minecraft_submissions.zst           a file of one subreddit",
        "kb reddit import ~/dumps                             every dump in a folder",
    ],
)
def reddit_import(
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
        str | None, _date("--since", help="Only posts and comments from this time on (UTC).")
    ] = None,
    until: Annotated[
        str | None, _date("--until", help="Only posts and comments before this time (UTC).")
    ] = None,
) -> Summary:
    """Import the subreddit's posts and comments from archive dumps. Sends nothing; needs no key.

    Folders are searched for dumps. The summary counts damaged lines, truncated files and files of
    a folder that are not dumps. After an interruption the same command resumes.
    """
    from kb.reddit.crawl.importer import import_dumps
    from kb.youtube.ytdlp.info import holds_info

    begin, end = parse_span(since, until)
    from kb.cli.framework.failed_import import importing

    with importing(run, files, "youtube", holds_info):
        return import_dumps(run, files, since=begin, until=end)


add_filter(reddit_app, "reddit")
add_export(reddit_app, "reddit")


@command(
    reddit_app,
    uses=("workers", "wait"),
    limit="Stop after N more posts and comments (exit code 3); the next run resumes.",
    again="Ask for every id again, or read the dumps again, even where all were answered.",
    json="posts, comments, missing, requests, bad_lines, truncated_files",
    planned=("ids", "dumps"),
    cls=DumpsCommand,
    data="makes",
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


def _replay_unread_answers(run: Run, source: str) -> None:
    from kb.crawl.session import replay_unread_answers
    from kb.registry import SOURCES

    replay_unread_answers(run, source, SOURCES[source].connector)
