"""What a crawl begins with: keywords, another part's channels, items to retry, videos to judge."""

import logging
from collections.abc import Callable, Collection
from pathlib import Path

import pyarrow as pa

from kb.core import clock
from kb.core.config.profile.check import key_lines, line_of
from kb.core.config.profile.collecting import YouTubeSection
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from kb.store.tables.latest import newest
from kb.youtube.crawl.client import FINAL
from kb.youtube.crawl.reduce import (
    BEYOND,
    CHANNELS,
    RAW_INFO,
    RAW_STATISTICS,
    RAW_VIDEOS,
    SEARCHES,
    TRANSCRIPTS,
    UNJUDGED,
    UPLOADS,
    VIDEOS,
    Reducer,
    SearchItem,
    Uploads,
    search_key,
    uploads_list,
)
from kb.youtube.parse import answers as parse
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.parse.join import COUNTED, with_statistics
from kb.youtube.ytdlp import info

_log = logging.getLogger("kb.youtube")


def reopen(frontier: Frontier, profile: YouTubeSection) -> None:
    """What was taken as final without being a fact, or lay beyond fewer search_pages; and tracks
    that asked for a PO token on an earlier day: these come last, as what failed.
    """
    today = clock.stamp()[:10]
    asked_before = [
        key
        for key, _, reason, track in frontier.items(TRANSCRIPTS, "skipped")
        if reason == PO_TOKEN and (track is None or track.po_token != today)
    ]
    frontier.mark(TRANSCRIPTS, asked_before, "error", PO_TOKEN)
    most = profile.search_pages
    pages = [
        key
        for key, _, reason, page in frontier.items(SEARCHES, "skipped")
        if reason != BEYOND or page.page <= most
    ]
    frontier.mark(SEARCHES, pages, "todo")
    lists = [key for key, _, reason, _ in frontier.items(UPLOADS, "skipped") if reason not in FINAL]
    frontier.mark(UPLOADS, lists, "todo")
    frontier.reopen(VIDEOS, "skipped")


def extend(frontier: Frontier, profile: YouTubeSection, mine: Callable[[str], bool]) -> None:
    """Add the profile's keywords, and channels that were another part's share."""
    frontier.add(
        SEARCHES, [(search_key(word, None), SearchItem(word)) for word in profile.keywords]
    )
    channels = (key for key, *_ in frontier.items(CHANNELS) if mine(key))
    frontier.add(UPLOADS, [(key, Uploads(uploads_list(key, profile))) for key in channels])


def new_round(frontier: Frontier) -> None:
    """Every first page of a search and every list again, when the last round is complete."""
    if any(frontier.ready(kind) for kind in (SEARCHES, UPLOADS, VIDEOS)):
        return
    with frontier.transaction():
        frontier.set_cursor("round", frontier.cursor("round", 1) + 1)
        searches = [key for key, *_ in frontier.items(SEARCHES)]
        frontier.remove(SEARCHES, [key for key in searches if not key.endswith("#")])
        frontier.mark(SEARCHES, [key for key in searches if key.endswith("#")], "todo")
        frontier.reopen(UPLOADS, "done", "skipped")


def no_channel(run: Run, unproductive: Collection[str], channels: int) -> FatalError | None:
    """Warn of keywords that find no channel; the error where none finds any: nothing can follow."""
    path = run.profile.path
    words = set(run.profile.section(YouTubeSection).keywords)
    if len(unproductive) == len(words) and not channels:
        return FatalError(
            f"no keyword of the profile {run.profile.name!r} finds a channel:"
            f" {', '.join(map(repr, unproductive))}",
            hint=f"change `keywords` under [youtube] in {path}{_line(path)}",
        )
    for word in unproductive:
        _log.warning(
            "the keyword %r of the profile finds no channel (%s%s)", word, path, _line(path)
        )
    return None


def _line(path: Path) -> str:
    """Where the keywords stand in a profile, as ", line 8"."""
    try:
        lines = key_lines(path.read_text(encoding="utf-8"))
    except OSError:
        return ""
    return f", line {line_of(lines, 'youtube.keywords')}"


def judge_pending(reducer: Reducer, root: Path, frontier: Frontier) -> None:
    """Queue transcripts of videos recorded by a command that fetches none, such as a refresh.

    Raises DamagedData.
    """
    if not reducer.wants or not frontier.cursor(UNJUDGED, False):
        return
    counts = _newest_counts(root)
    for path in rawlog.segments(root, "youtube", RAW_VIDEOS):
        with frontier.transaction():
            for _, line in rawlog.Frames(path, 0, checked=True):
                for rows in parse.videos_of(rawlog.decode(line)):
                    reducer.judge(frontier, with_statistics(rows, counts))
    for path in rawlog.segments(root, "youtube", RAW_INFO):
        for rows in info.rows(line for _, line in rawlog.Frames(path, 0, checked=True)):
            reducer.judge(frontier, with_statistics(rows, counts))
    frontier.set_cursor(UNJUDGED, None)


def _newest_counts(root: Path) -> pa.Table:
    """The latest counts of each video from batchGetStats."""
    tables = [
        rows
        for path in rawlog.segments(root, "youtube", RAW_STATISTICS)
        for rows in parse.statistics(line for _, line in rawlog.Frames(path, 0, checked=True))
    ]
    names = ["video_id", *COUNTED, "fetched_at"]
    if not tables:
        return pa.table({name: pa.nulls(0) for name in names})
    return newest(pa.concat_tables(tables).select(names), ("video_id",), ("fetched_at",))
