"""YouTube: two services over one frontier, so that the API's quota and the web site's patience are
used side by side.

    api    searches → uploads and playlists → videos, 50 ids a call packed across channels
    web    transcripts of the videos that pass the cheap filters, in several threads

    fetch         what to ask: api (Google's client on our transport), transcripts, player, quota
    reduce        what an answer means for the frontier
    parse         answers to columns; assemble: columns to the tables
    plan, refresh, purge
"""

import logging
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.config.profile.check import key_lines, line_of
from kb.core.config.section import read_text
from kb.core.context import Run
from kb.core.errors import FatalError, KbError, SettingError
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Connector, Opened, Phase, seed_requests
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession
from kb.crawl.share import Part, share
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier, Item
from kb.store.tables.columns import newest
from kb.youtube.crawl.client import FINAL, GOOGLE
from kb.youtube.crawl.fetch import YouTubeFetcher
from kb.youtube.crawl.ids import RULES, sorted_by_form
from kb.youtube.crawl.phases import PHASES, chosen_phases, words_of
from kb.youtube.crawl.quota import API, WEB, quota
from kb.youtube.crawl.reduce import (
    BEYOND,
    CHANNELS,
    ELSEWHERE,
    PAYLOADS,
    PLAYLIST_SEARCHES,
    PLAYLISTS,
    RAW_INFO,
    RAW_STATISTICS,
    RAW_VIDEOS,
    SEARCHES,
    TRANSCRIPTS,
    UNJUDGED,
    UPLOADS,
    VIDEOS,
    ListPlace,
    Reducer,
    SearchItem,
    Wanted,
    crawled,
    nothing,
    search_key,
    unproductive_words,
    uploads_list,
    with_po_token,
)
from kb.youtube.crawl.transcripts import SITE
from kb.youtube.parse import answers as parse
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.parse.assemble import COUNTED, assemble, with_statistics
from kb.youtube.parse.channels import ChannelFilter
from kb.youtube.section import YouTubeSection
from kb.youtube.ytdlp import info

_log = logging.getLogger("kb.youtube")

REFRESHED = "refreshed playlists"  # cursor: by playlist, when a refresh asked for its entries
WEEK = timedelta(days=7)


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
    for kind in (SEARCHES, PLAYLIST_SEARCHES):
        skipped = frontier.items(kind, "skipped")
        pages = [key for key, _, why, page in skipped if why != BEYOND or page.page <= most]
        frontier.mark(kind, pages, "todo")
    for kind in (UPLOADS, PLAYLISTS):
        lists = [key for key, _, why, _ in frontier.items(kind, "skipped") if why not in FINAL]
        frontier.mark(kind, lists, "todo")
    frontier.reopen(VIDEOS, "skipped")


def extend(frontier: Frontier, profile: YouTubeSection, mine: Callable[[str], bool]) -> None:
    """Add the profile's keywords, and channels that were another part's share."""
    for kind, words in words_of(profile).items():
        frontier.add_keys(kind, [(search_key(word, None), SearchItem(word)) for word in words])
    channels = (key for key, *_ in frontier.items(CHANNELS) if mine(key))
    frontier.add_keys(UPLOADS, [(key, ListPlace(uploads_list(key, profile))) for key in channels])


def new_round(frontier: Frontier) -> None:
    """Every first page of a search and every list again, when the last round is complete."""
    searched, lists = (SEARCHES, PLAYLIST_SEARCHES), (UPLOADS, PLAYLISTS)
    if any(frontier.ready(kind) for kind in (*searched, *lists, VIDEOS)):
        return
    with frontier.transaction():
        frontier.set_cursor("round", frontier.cursor("round", 1) + 1)
        for kind in searched:
            searches = [key for key, *_ in frontier.items(kind)]
            frontier.remove(kind, [key for key in searches if not key.endswith("#")])
            frontier.mark(kind, [key for key in searches if key.endswith("#")], "todo")
        just_read = _just_refreshed(frontier)
        for kind in lists:
            frontier.reopen(kind, "done", "skipped")
        frontier.mark(PLAYLISTS, just_read, "done")
        frontier.set_cursor(REFRESHED, None)


def _just_refreshed(frontier: Frontier) -> list[str]:
    """Playlists that a refresh has read in the last week: as an update does before its round."""
    at = frontier.cursor(REFRESHED, {}, of=dict[str, str])
    oldest = clock.now() - WEEK
    done = (key for key, *_ in frontier.items(PLAYLISTS, "done"))
    return [key for key in done if key in at and clock.parse(at[key]) >= oldest]


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
        lines = key_lines(read_text(path))
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


PART = "part"  # cursor: the share that the last run had
Worth = Callable[[pa.Table], "pa.Array[Any]"]
"""Which assembled videos are worth asking for their transcript."""


def crawl(
    run: Run,
    worth: Worth,
    only: str | None = None,
    ids: Path | None = None,
    part: Part = None,
) -> Summary:
    """Crawl until nothing is left. `worth` says of assembled videos whose transcript is asked for.

    `only` names one phase; `ids` are known videos and playlists, which skip discovery; `part`
    (i, n) is one machine's share. Raises Stopped (with `summary`) when something is left for
    another run, and what kb.core.errors says for the rest.
    """
    source = YouTubeConnector(run, partial(_promising, worth), only=only, ids=ids, part=part)
    if only is None or ids:  # a phase alone goes on with what was asked for before
        bounds = {"ids": str(ids.absolute()) if ids else "", "part": "/".join(map(str, part or ()))}
        source.asked = {name: text for name, text in bounds.items() if text}
    try:
        summary = work(run, source, source.summary, phases=source.chosen, facts=source.facts)
    except KbError as error:
        if error.summary is not None:
            source.check_keywords(error.summary)
        raise
    source.check_keywords(summary)
    if part and ids is None:
        run.progress.say(
            f"youtube: this part has searched its share of the keywords and read its share of the"
            f" {summary['channels']:,} channels that it knows; `kb merge` adds those that"
            " others have found"
        )
    if not summary["requests"]:
        more = "" if run.again else "; --again starts a new round"
        run.progress.say(f"youtube: nothing left to crawl{more}")
    return summary


def _promising(worth: Worth, videos: pa.Table) -> list[str]:
    """Ids of the parsed videos that are worth it."""
    # No transcript is among them, so no words are counted.
    rows = assemble({"videos": videos}, words=pc.list_value_length)["youtube/videos"]
    return cast("list[str]", rows.filter(worth(rows))["video_id"].to_pylist())


class YouTubeConnector(Connector):
    """One run's source. Raises SettingError for ids that can't be read.

    `chosen` are the phases of this run; `counts` what it had, by the names of its summary; `theirs`
    the videos that it was asked for of channels to be left out.
    """

    name = "youtube"
    payloads = PAYLOADS

    def __init__(
        self,
        run: Run,
        wanted: Wanted = nothing,
        *,
        only: str | None = None,
        ids: Path | None = None,
        part: Part = None,
    ) -> None:
        if ids and only in ("channels", "uploads"):
            raise SettingError(
                f"--ids skips discovery, so there is nothing to do for --only {only}",
                hint="drop one of the two",
            )
        self.run, self.profile = run, run.profile.section(YouTubeSection)
        self.phases = [
            replace(phase, workers=max(1, min(run.workers, phase.workers))) for phase in PHASES
        ]
        self.chosen = chosen_phases(self.phases, only, ids)
        self._known = RULES.some_ids_in(ids, run.progress.say) if ids else None
        self._wanted, self._mine, self._part = wanted, share(part), list(part or ())
        self.counts: Counter[str] = Counter()
        self.theirs: set[str] = set()
        self._unproductive: dict[str, list[str]] = {}
        self._fetch: YouTubeFetcher | None = None
        self._lock = threading.Lock()

    def identity(self) -> dict[str, str]:
        """The two hosts. Raises MissingCredential, SettingError."""
        settings = self.run.settings
        if any(phase.service == API for phase in self.chosen):
            settings.require("youtube_api_key")
        settings.check_contact()
        return {
            "api": settings.kb_youtube_endpoint or GOOGLE,
            "web": settings.kb_youtube_web or SITE,
        }

    def begin(self, opened: Opened) -> None:
        """What reads and asks knows the data root now."""
        super().begin(opened)
        self.left_out = ChannelFilter(tombstones.people(self.run.root, self.name))
        self._reduce = Reducer(
            self.profile,
            self._wanted,
            self._mine,
            opened.purged,
            self.left_out,
            by_id=self._known is not None,
        )
        self._fetch = YouTubeFetcher(self.profile, opened, self._count)

    def seeds(self, frontier: Frontier) -> Iterator[dict[str, Any]]:
        """The ids of the list that are this part's share."""
        keys = self._known.keys if self._known is not None else ()
        mine = (key for key in keys if key not in self.opened.purged and self._mine(key))
        videos, lists = sorted_by_form(mine)
        yield from seed_requests(frontier, VIDEOS, "ids", videos)
        yield from seed_requests(frontier, PLAYLISTS, "playlists", lists)

    def discover(self, frontier: Frontier) -> None:
        """Known ids, or the profile's keywords, channels, and a new round."""
        reopen(frontier, self.profile)
        if frontier.cursor(PART, []) != self._part:  # what was left to other machines counts now
            frontier.set_cursor(PART, self._part)
            frontier.set_cursor(UNJUDGED, True)
        judge_pending(self._reduce, self.run.root, frontier)
        if self._known is not None:
            return
        extend(frontier, self.profile, self._mine)
        if self.run.again:
            new_round(frontier)

    def leave_out(self, phase: Phase, item: Item) -> str | None:
        """Pages of a search that the profile does not want, or that another part asks for."""
        if phase.kind not in words_of(self.profile):
            return None
        if item.payload.page > self.profile.search_pages:
            return BEYOND
        return None if self._mine(item.payload.q) else ELSEWHERE

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """A page of a search or list, a pack of videos, or one transcript. Whose a video is, an
        answer says: those of channels to be left out are forgotten.
        """
        assert self._fetch is not None
        for answer in self._fetch(phase.kind, items):
            left = self.left_out.without(answer.kind, answer.params, answer.response)
            if left is not None:
                yield replace(answer, params=left[0], response=left[1])
            asked = parse.requested(answer.params) if left else [item.key for item in items]
            theirs = set(asked).difference(parse.requested(left[0]) if left else ())
            if theirs:
                self.theirs |= theirs
                self.counts["crawled"] -= len(theirs)
                self.opened.frontier.remove(phase.kind, theirs)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        self._reduce(frontier, kind, envelope)

    def close(self) -> None:
        if self._fetch is not None:
            self._fetch.close()

    # -- what is told ------------------------------------------------------------------------------

    def _count(self, **numbers: int) -> None:
        with self._lock:
            self.counts.update(numbers)

    def facts(self, phase: Phase) -> dict[str, object]:
        """The quota that a phase spends, for its progress."""
        if phase.service == WEB:
            return {}
        asked = quota(self.profile, phase.bucket)
        return {"quota": f"{asked.used(self.opened.frontier):,}/{asked.per_day:,}"}

    def summary(self, session: CrawlSession, loop: Loop) -> Summary:
        """What the run did, what failed and what is left."""
        frontier = session.frontier
        self._unproductive = {}
        for kind, words in words_of(self.profile).items():
            if any(phase.kind == kind for phase in self.chosen):
                self._unproductive[kind] = unproductive_words(frontier, kind, words)
        kinds = frontier.kinds()
        handled = {phase.kind: kinds.get(phase.kind, {}) for phase in self.chosen}
        left = SOURCES["youtube"].left_by(handled)
        requests, units = session.requests()
        return Summary(
            command="youtube crawl",
            source="youtube",
            counted="videos",
            crawled=self.counts["crawled"],
            crawled_in_all=crawled(frontier),
            missing=self.counts["missing"],
            failed=sum(count.get("error", 0) for count in handled.values()),
            pending=frontier.waiting(VIDEOS),
            channels=kinds.get(CHANNELS, {}).get("done", 0),
            playlists=kinds.get(PLAYLISTS, {}).get("done", 0),
            transcripts_asked=self.counts["transcripts_asked"],
            transcripts=self.counts["transcripts"],
            po_token=with_po_token(frontier),
            requests=requests,
            units=units,
            bad_lines=self._known.bad_lines if self._known else 0,
            left=sum(left.values()),
            left_by=left,
        )

    def of_known(self, command: str, session: CrawlSession, *kinds: str) -> Summary:
        """What a run over known videos did, `kinds` of the frontier; what is left is not in it."""
        requests, units = session.requests()
        return Summary(
            command=command,
            source="youtube",
            counted="videos",
            crawled=self.counts["crawled"],
            missing=self.counts["missing"],
            failed=sum(session.frontier.counts(kind).get("error", 0) for kind in kinds),
            requests=requests,
            units=units,
        )

    def check_keywords(self, summary: dict[str, Any]) -> None:
        """Name keywords that find no channel. Raises FatalError where none finds any."""
        without = self._unproductive.get(SEARCHES, ())
        error = no_channel(self.run, without, summary["channels"])
        for word in self._unproductive.get(PLAYLIST_SEARCHES, ()):
            _log.warning("the phrase %r of the profile finds no playlist", word)
        if error is not None:
            error.summary = summary
            raise error
