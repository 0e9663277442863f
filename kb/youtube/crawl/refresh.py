"""Read again what is older than the profile allows: data that is not refreshed should go, say
the terms of YouTube's API.

    refresh      videos.list: all of the metadata, of videos whose metadata are older than the
                 profile allows, or known by an imported file only
    statistics   videos.batchGetStats: the counts of other videos that are due, by a bucket of its
                 own; a video that it leaves out is asked for by videos.list

    playlists    playlists.list: titles of playlists, and playlistItems.list: what they list

Newer answers win when filtering. Only videos.list says that a video is gone, as the first call
does not answer all or nothing; such a video becomes `missing`, and `kb purge youtube` removes it.
So it does with a playlist that playlists.list leaves out.
"""

import math
from collections.abc import Collection
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kb.core import clock
from kb.core.context import Run
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.core.summary.plan import PlanPhase as Step
from kb.core.summary.plan import plan
from kb.crawl.connector import Opened, Phase
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.store.state.frontier import ROUND, Frontier, going_on
from kb.youtube.crawl import quota
from kb.youtube.crawl.connector import REFRESHED, YouTubeConnector
from kb.youtube.crawl.fetch import PACK
from kb.youtube.crawl.phases import PLAYLIST_PAGES, PLAYLISTS_READ
from kb.youtube.crawl.reduce import (
    PLAYLIST_FACTS,
    PLAYLISTS,
    RAW_FACTS,
    RAW_INFO,
    RAW_STATISTICS,
    RAW_VIDEOS,
    REFRESH,
    STATISTICS,
    ListPlace,
)
from kb.youtube.parse import answers as parse
from kb.youtube.parse.playlists import last_read
from kb.youtube.section import YouTubeSection

# Compressed, of 50 videos or of a page of a playlist.
BYTES_A_CALL = {REFRESH: 60_000, STATISTICS: 3_000, PLAYLIST_FACTS: 3_000}
_QUEUED = (REFRESH, STATISTICS, PLAYLIST_FACTS)  # by a refresh, and by it alone
READ = Phase(
    kind=REFRESH,
    unit="videos",
    name="refresh",
    batch=PACK,
    packed=True,
    service=quota.API,
    bucket=quota.GENERAL,
    limited=True,
)
COUNT = Phase(
    kind=STATISTICS,
    unit="videos",
    feeds=(REFRESH,),
    batch=PACK,
    service=quota.API,
    bucket=quota.STATISTICS,
    limited=True,
)


class _VideoId(msgspec.Struct, gc=False):
    id: Any = None


class _Returned(msgspec.Struct, gc=False):
    id: Any = None
    items: list[_VideoId] = []


class _Answer(msgspec.Struct, gc=False):
    """Of an envelope, when and what was asked, and whom the answer is about."""

    fetched_at: str
    request: rawlog.Request
    response: _Returned


class Reading(NamedTuple):
    """When a video was last read (RFC 3339), and whether the answer had it."""

    at: str
    there: bool


def newest(root: Path, kind: str) -> dict[str, Reading]:
    """The newest reading of each video in answers of a raw kind.

    What videos.list leaves out is gone; of the others only what they have counts.
    """
    decoder = msgspec.json.Decoder(_Answer)
    readings: dict[str, Reading] = {}
    for path in rawlog.segments(root, "youtube", kind):
        for _, line in rawlog.Frames(path, checked=True):
            answer = decoder.decode(line)
            shown = (answer.response.id, *(item.id for item in answer.response.items))
            there = {key for key in shown if isinstance(key, str)}
            whole = kind in (RAW_VIDEOS, RAW_FACTS)
            asked = parse.requested(answer.request.params) if whole else there
            for key in asked:
                before = readings.get(key)
                if before is None or before.at <= answer.fetched_at:
                    readings[key] = Reading(answer.fetched_at, key in there)
    return readings


def plan_refresh(run: Run, older_than: int | None = None) -> Summary:
    """What a refresh would read again now, and its units by bucket. Sends and writes nothing."""
    purged = tombstones.keys(run.root, "youtube")
    metadata, counts = _due(run, run.profile.section(YouTubeSection), purged, older_than)
    phases = [
        _step("videos to refresh", REFRESH, len(metadata)),
        _step("statistics to refresh", STATISTICS, len(counts)),
    ]
    titles, lists = _due_playlists(run, purged, older_than)
    if titles or lists:
        calls = math.ceil(len(titles) / PACK) + len(lists)
        gb = calls * BYTES_A_CALL[PLAYLIST_FACTS] / 1e9
        items = len({*titles, *lists})
        phases.append(Step("playlists", items, requests=calls, units=calls, gb=gb))
    assumed = [
        f"{PACK} videos a call",
        f"statistics spend a quota of their own, {quota.STATISTICS_PER_DAY:,} units a day",
        "every video is still there: one that the statistics leave out is asked for again in full",
    ]
    return Summary(plan("refresh youtube", "youtube", phases, assumed))


def _step(name: str, kind: str, items: int) -> Step:
    calls = math.ceil(items / PACK)
    return Step(name, items, requests=calls, units=calls, gb=calls * BYTES_A_CALL[kind] / 1e9)


def _due(
    run: Run, profile: YouTubeSection, purged: Collection[str], older_than: int | None
) -> tuple[list[str], list[str]]:
    """Videos whose metadata, and those whose counts alone, are older than so many days; by default
    what the profile allows for the metadata.
    """
    days = profile.max_age_days if older_than is None else older_than
    oldest = clock.now() - timedelta(days=days)
    too_old = clock.now() - timedelta(days=max(days, profile.max_age_days))
    in_full, filed = newest(run.root, RAW_VIDEOS), newest(run.root, RAW_INFO)
    statistics = newest(run.root, RAW_STATISTICS)
    metadata, counts = list[str](), list[str]()
    for key in {**in_full, **filed}:
        if key in purged:
            continue
        full = in_full.get(key)
        counted = max(times[key].at for times in (in_full, filed, statistics) if key in times)
        if clock.parse((full or filed[key]).at) < too_old:
            metadata.append(key)
        elif clock.parse(counted) < oldest or older_than == 0:
            # With 0 days also what was read in this very second.
            (metadata if full is None else counts).append(key)
    return metadata, counts


def _due_playlists(
    run: Run, purged: Collection[str], older_than: int | None
) -> tuple[list[str], list[str]]:
    """Playlists whose titles, and those whose entries, were last read before so many days."""
    most = run.profile.section(YouTubeSection).max_age_days
    days = most if older_than is None else max(older_than, most) if older_than else 0
    oldest = clock.now() - timedelta(days=days)

    def is_due(at: str | None) -> bool:
        if not at:
            return False
        return days == 0 or clock.parse(at) < oldest

    read = {key: at for key, at in last_read(run.root).items() if key not in purged}
    titles = [key for key, at in read.items() if is_due(at.facts)]
    return titles, [key for key, at in read.items() if is_due(at.entries)]


def refresh(run: Run, older_than: int | None = None) -> Summary:
    """Read every video again whose metadata are older than `max_age_days`, and find out which
    videos are gone.

    With `older_than` also the counts that are older than so many days (0: all of them). What it
    found due is kept until it is read, so the same command resumes. One unit for
    50 videos. Raises Stopped with `summary` when something is left.
    """
    source = YouTubeRefresh(run, older_than)
    return work(run, source, source.summary, phases=source.chosen, facts=source.facts)


class YouTubeRefresh(YouTubeConnector):
    """The videos that are due. Nothing is asked of the web site: transcripts don't age."""

    def __init__(self, run: Run, older_than: int | None) -> None:
        super().__init__(run)
        self.chosen = [READ, COUNT, PLAYLISTS_READ, PLAYLIST_PAGES]
        self._older_than, self._goes_on = older_than, False

    def begin(self, opened: Opened) -> None:
        """See whether a refresh was stopped, before what has failed is opened again."""
        super().begin(opened)
        frontier = opened.frontier
        asked = frontier.cursor(REFRESHED, {}, of=dict[str, str])
        lists_left = any(key in asked for key, *_ in frontier.items(PLAYLISTS, "todo"))
        self._goes_on = any(
            going_on(frontier, kind, self._older_than)
            for kind in (*_QUEUED, *((PLAYLISTS,) if lists_left else ()))
        )

    def discover(self, frontier: Frontier) -> None:
        """What is due, unless the last refresh has left something."""
        if not self._goes_on:
            due = _due(self.run, self.profile, self.opened.purged, self._older_than)
            with frontier.transaction():
                titles, lists = _due_playlists(self.run, self.opened.purged, self._older_than)
                for kind, keys in zip(_QUEUED, (*due, titles), strict=True):
                    frontier.replace(kind, keys)
                frontier.add_keys(PLAYLISTS, [(key, ListPlace(key)) for key in lists])
                frontier.mark(PLAYLISTS, lists, "todo")
                asked = frontier.cursor(REFRESHED, {}) | dict.fromkeys(lists, clock.stamp())
                frontier.set_cursor(REFRESHED, asked)
                frontier.set_cursor(ROUND, self._older_than)
        if not any(frontier.ready(phase.kind) for phase in self.chosen):
            days = self.profile.max_age_days if self._older_than is None else self._older_than
            self.run.progress.say(f"youtube: nothing is older than {days} days")

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """What was read again, and what is left."""
        kinds = {phase.kind: session.frontier.counts(phase.kind) for phase in self.chosen}
        left = SOURCES["youtube"].left_by(kinds)
        asked = self.of_known("refresh youtube", session, *kinds)
        return Summary(asked, left=sum(left.values()), left_by=left)
