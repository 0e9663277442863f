"""The crawl: two lanes over one frontier, so that the API's quota and the web site's patience are used side by side.

    API lane (this thread)    searches → uploads → videos, 50 ids a call packed across channels
    web lane (threads)        transcripts of the videos that pass the cheap filters

A lane that must stop (quota spent, blocked) lets the other one go on; then the run ends with exit 3.
With a limit only as much is listed and searched as the videos need.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from kb.core import clock, signals
from kb.core.context import Run
from kb.core.errors import ItemFinal, KbError, LimitReached, QuotaSpent, Retryable, Stopped, Unreachable
from kb.core.verdict import Summary
from kb.net.rate import Pace, is_loopback
from kb.store import identity, lock, tombstones
from kb.store.frontier import Frontier, Item
from kb.store.recorder import Recorder
from kb.youtube import effects, parse
from kb.youtube.api import GOOGLE, Api
from kb.youtube.effects import SEARCHES, TRANSCRIPTS, UPLOADS, VIDEOS, Effects, Wanted
from kb.youtube.ids import read_ids, share
from kb.youtube.quota import GENERAL, SEARCH, WEB, limit, today
from kb.youtube.transcripts import SITE, Fetcher

PACK = 50
PARTS = "snippet,contentDetails,statistics,status,player"
FRAME = {"maxWidth": 1920, "maxHeight": 1080}      # of the embed: its shape is the video's
PHASES = {"channels": (SEARCHES,), "uploads": (UPLOADS,), "metadata": (VIDEOS,), "transcripts": (TRANSCRIPTS,)}
NAMES = {VIDEOS: "metadata"}
HOPELESS = 3        # so many requests failed one after the other: the service is down, not the item


def crawl(run: Run, wanted: Wanted, *, only: str | None = None, ids: Path | None = None,
          part: tuple[int, int] | None = None) -> Summary:
    """Crawl until nothing is left. `wanted` picks the videos whose transcript is worth asking for.

    Raises Stopped (with `summary`) when something is left for another run, and what kb.core.errors says for the rest.
    """
    profile = run.profile.section("youtube")
    if only != "transcripts":
        run.settings.need("youtube_api_key")
    known, bad_lines = read_ids(ids) if ids else ([], 0)
    mine = share(part)
    with ExitStack() as stack:
        stack.enter_context(lock.writer(run.root, "youtube"))
        identity.remember(run.root, "youtube", api=run.settings.kb_youtube_endpoint or GOOGLE, web=run.settings.kb_youtube_web or SITE)
        frontier = Frontier(run.root / "state" / "youtube.sqlite")
        stack.callback(frontier.close)
        purged = tombstones.keys(run.root, "youtube")
        recorder = stack.enter_context(Recorder(run.root, "youtube", frontier, Effects(profile, wanted, mine, purged)))
        phases = set(PHASES[only]) if only else {VIDEOS, TRANSCRIPTS} if ids else {kind for kinds in PHASES.values() for kind in kinds}
        job = Crawl(run, frontier, recorder, phases)
        job.summary["bad_lines"] = bad_lines
        if ids:
            frontier.add(VIDEOS, [key for key in known if mine(key) and key not in purged])
        job.begin()
        return job.run_lanes()


class Crawl:
    """One run over the frontier."""

    def __init__(self, run: Run, frontier: Frontier, recorder: Recorder, phases: set[str]) -> None:
        self.run, self.frontier, self.recorder, self.phases = run, frontier, recorder, phases
        self.profile = run.profile.section("youtube")
        self.summary = Summary(crawled=0, transcripts=0, failed=0, missing=0, requests=0, units=0, bad_lines=0, left=0)
        self._start = frontier.requests()
        self._lock = threading.Lock()
        self._web_stop: KbError | None = None
        self._api_done = threading.Event()
        self._news = threading.Condition()
        self._tasks: dict[str, Any] = {}
        self._bad_luck = self._web_bad_luck = 0
        # What the limit counts: videos, or what the one phase handles that --only names.
        self._counts = VIDEOS if VIDEOS in phases else next(iter(phases))
        self._counted = 0

    def begin(self) -> None:
        """Extend the frontier by new keywords; what failed before gets another chance; a new round starts over."""
        frontier = self.frontier
        frontier.add(SEARCHES, [(effects.search_key(word, None), {"q": word, "token": None, "page": 1}) for word in self.profile.keywords])
        for kind in (SEARCHES, UPLOADS, VIDEOS, TRANSCRIPTS):
            frontier.reopen(kind, "error")
        if self.run.again and not any(frontier.ready(kind) for kind in (SEARCHES, UPLOADS, VIDEOS)):
            with frontier.transaction():
                frontier.set_cursor("round", frontier.cursor("round", 1) + 1)
                first_pages = [key for key, *_ in frontier.items(SEARCHES) if key.endswith("#")]
                frontier.remove(SEARCHES, [key for key, *_ in frontier.items(SEARCHES) if not key.endswith("#")])
                frontier.mark(SEARCHES, first_pages, "todo")
                frontier.reopen(UPLOADS, "done", "skipped")

    def run_lanes(self) -> Summary:
        """Both lanes until they end; the summary, or the reason to stop."""
        stops: list[KbError] = []
        threads = []
        if TRANSCRIPTS in self.phases:
            pace = Pace(0 if is_loopback(self.run.settings.kb_youtube_web or SITE) else 3600 / self.profile.transcripts_per_hour)
            workers = max(1, min(self.run.workers, 4))
            threads = [threading.Thread(target=self._web_lane, args=(pace,), name=f"transcripts-{number}") for number in range(workers)]
        for thread in threads:
            thread.start()
        try:
            self._api_lane()
        except KbError as stop:
            stops.append(stop)
            if not isinstance(stop, (QuotaSpent, LimitReached)):
                self._end_web(stop)
        except BaseException as error:
            self._end_web(Stopped(str(error)))
            raise
        finally:
            self._api_done.set()
            self._wake()
            for thread in threads:
                thread.join()
            for task in self._tasks.values():
                task.close()
        if self._web_stop is not None:
            stops.append(self._web_stop)
        return self._finish(stops)

    def _finish(self, stops: list[KbError]) -> Summary:
        requests, units = self.frontier.requests()
        self.summary |= {
            "requests": requests - self._start[0], "units": units - self._start[1],
            "failed": sum(self.frontier.counts(kind).get("error", 0) for kind in self.phases),
            "left": sum(self.frontier.counts(kind).get("todo", 0) for kind in self.phases),
        }
        # A limit that took everything there was is no stop.
        stops = [stop for stop in stops if not (isinstance(stop, LimitReached) and self.summary["left"] == 0)]
        if stops:
            worst = min(stops, key=lambda stop: stop.exit_code if stop.exit_code != 3 else 9)
            worst.summary = self.summary
            raise worst
        if not self.summary["requests"]:
            self.run.progress.say("youtube: nothing left to crawl; --again starts a new round")
        return self.summary

    # -- API lane ------------------------------------------------------------------------------------

    def _api_lane(self) -> None:
        if not self.phases & {SEARCHES, UPLOADS, VIDEOS}:
            return
        api = Api(self.run.settings, self.profile, self.frontier) if self._api_work() else None
        spent: dict[str, QuotaSpent] = {}       # by phase: what to say in the end
        try:
            while api is not None:
                signals.stop.check()
                step = self._next_step(spent)
                if step is None:
                    if spent and self.run.wait:
                        self._sleep_until_reset(spent)
                        continue
                    break
                try:
                    {SEARCHES: self._search, UPLOADS: self._list, VIDEOS: self._read}[step](api)
                except QuotaSpent as stop:
                    spent |= {SEARCHES: stop} if step == SEARCHES else {UPLOADS: stop, VIDEOS: stop}
        finally:
            if api is not None:
                api.close()
        if spent:
            raise next(iter(spent.values()))
        if self._room() <= 0:
            raise self._limit()

    def _api_work(self) -> bool:
        return any(self.frontier.ready(kind) for kind in self.phases & {SEARCHES, UPLOADS, VIDEOS})

    def _room(self) -> int:
        """How many more items the limit allows; items are those of the last phase of the API lane that runs."""
        return PACK if self.run.limit is None else self.run.limit - self._counted

    def _next_step(self, spent: dict[str, QuotaSpent]) -> str | None:
        """The phase whose turn it is: the one nearest to the end that has enough to do."""
        open_phases = {kind for kind in self.phases & {SEARCHES, UPLOADS, VIDEOS} if kind not in spent and self.frontier.ready(kind)}
        wanted = min(PACK, self._room())
        if wanted <= 0:
            return None
        if VIDEOS in open_phases and (self.frontier.ready(VIDEOS, PACK) >= wanted or not open_phases & {SEARCHES, UPLOADS}):
            return VIDEOS
        return next((kind for kind in (UPLOADS, SEARCHES) if kind in open_phases), None)

    def _search(self, api: Api) -> None:
        (item,) = self.frontier.take(SEARCHES, 1)
        if item.payload["page"] > self.profile.search_pages:
            self.frontier.skip(SEARCHES, item.key, "beyond search_pages")
            return
        params = _with({"q": item.payload["q"], "type": "channel", "part": "snippet", "maxResults": PACK}, pageToken=item.payload["token"])
        answer = self._ask([item], lambda: api.search(**params))
        if answer is not None:
            self.recorder.record(effects.RAW_SEARCH, "search.list", params, 200, answer)
            self._show(SEARCHES, "pages")

    def _list(self, api: Api) -> None:
        (item,) = self.frontier.take(UPLOADS, 1)
        params = _with({"playlistId": item.payload["playlist"], "part": "contentDetails", "maxResults": PACK}, pageToken=item.payload["token"])
        try:
            answer = self._ask([item], lambda: api.playlist_items(**params), final=False)
        except ItemFinal as fact:
            if fact.reason != "not_found":
                self.frontier.skip(UPLOADS, item.key, fact.reason)
                return
            self.recorder.record(effects.RAW_LIST, "playlistItems.list", params, 404, {"error": {"code": 404}})
            return
        if answer is not None:
            self.recorder.record(effects.RAW_LIST, "playlistItems.list", params, 200, answer)
            self._show(UPLOADS, "pages")

    def _read(self, api: Api) -> None:
        items = self.frontier.take(VIDEOS, min(PACK, self._room()))
        params = {"id": ",".join(item.key for item in items), "part": PARTS, **FRAME}
        answer = self._ask(items, lambda: api.videos(**params))
        if answer is None:
            return
        self.recorder.record(effects.RAW_VIDEOS, "videos.list", params, 200, answer)
        with self._lock:
            self.summary["crawled"] += len(items)
            self.summary["missing"] += len(parse.missing(params, answer))
        self._show(VIDEOS, "videos", len(items))
        self._wake()

    def _ask(self, items: list[Item], call: Callable[[], dict[str, Any]], *, final: bool = True) -> dict[str, Any] | None:
        """The answer; None when the items failed. What stops the run gives them back first."""
        kind, keys = items[0].kind, [item.key for item in items]
        try:
            answer = call()
            self._bad_luck = 0
            return answer
        except Retryable as error:
            self._bad_luck += 1
            for key in keys:
                self.frontier.error(kind, key, error.reason)
            if self._bad_luck >= HOPELESS:
                raise Unreachable(f"{error.reason}; {HOPELESS} requests failed one after the other",
                                  hint="the service seems to be down; the same command goes on") from error
            return None
        except ItemFinal as fact:
            if not final:
                raise
            for key in keys:
                self.frontier.skip(kind, key, fact.reason)
            return None
        except BaseException:
            self.frontier.release(kind, *keys)
            raise

    def _sleep_until_reset(self, spent: dict[str, QuotaSpent]) -> None:
        reset = min(stop.reset_at for stop in spent.values() if stop.reset_at)
        self.run.progress.say(f"youtube: quota spent; waiting until {clock.stamp(reset)}")
        while (seconds := (reset - clock.now()).total_seconds()) > 0:
            clock.sleep(min(seconds + 1, 60))
        spent.clear()

    # -- web lane ------------------------------------------------------------------------------------

    def _web_lane(self, pace: Pace) -> None:
        fetcher = Fetcher(self.run.settings, self.profile, pace, lambda endpoint: self.frontier.spend(WEB, 0, endpoint))
        try:
            while self._web_stop is None:
                signals.stop.check()
                with self._lock:
                    if self._counts == TRANSCRIPTS and self._room() <= 0:
                        raise self._limit()
                    items = self.frontier.take(TRANSCRIPTS, 1)
                    self._counted += len(items) if self._counts == TRANSCRIPTS else 0
                if not items:
                    if self._api_done.is_set() and not self.frontier.ready(TRANSCRIPTS):
                        return
                    with self._news:
                        self._news.wait(timeout=0.2)
                    continue
                self._transcript(fetcher, items[0])
        except KbError as stop:
            self._end_web(stop)
        except BaseException as error:  # noqa: BLE001  a thread's error must reach the run
            self._end_web(_as_stop(error))
        finally:
            fetcher.close()

    def _transcript(self, fetcher: Fetcher, item: Item) -> None:
        try:
            found = fetcher.fetch(item.key)
        except Retryable as error:
            found = {"video_id": item.key, "outcome": "failed", "reason": error.reason}
        except BaseException:
            self.frontier.release(TRANSCRIPTS, item.key)
            raise
        self.recorder.record(effects.RAW_TRANSCRIPTS, "transcript", {"video_id": item.key, "language": self.profile.language}, 200, found)
        with self._lock:
            self.summary["transcripts"] += found["outcome"] == "ok"
            self._web_bad_luck = self._web_bad_luck + 1 if found["outcome"] == "failed" else 0
        self._show(TRANSCRIPTS, "videos")
        if self._web_bad_luck >= HOPELESS * 2:
            raise Unreachable(f"{found['reason']}; {self._web_bad_luck} transcripts failed one after the other",
                              hint="the site seems to be in trouble; the same command goes on")

    def _end_web(self, stop: KbError) -> None:
        with self._lock:
            self._web_stop = self._web_stop or stop
        self._wake()

    def _wake(self) -> None:
        with self._news:
            self._news.notify_all()

    # -- both ----------------------------------------------------------------------------------------

    def _limit(self) -> LimitReached:
        return LimitReached(f"--limit {self.run.limit} reached", hint="run the same command to go on")

    def _show(self, phase: str, unit: str, n: int = 1) -> None:
        """Count `n` items of a phase, with the quota that it spends."""
        with self._lock:
            if phase == self._counts and phase != TRANSCRIPTS:
                self._counted += n
            if phase not in self._tasks:
                self._tasks[phase] = self.run.progress.task(NAMES.get(phase, phase), unit=unit)
            task = self._tasks[phase]
        if phase == TRANSCRIPTS:
            task.advance(n, waiting=self.frontier.ready(TRANSCRIPTS, 10_000))
        else:
            bucket = SEARCH if phase == SEARCHES else GENERAL
            task.advance(n, quota=f"{self.frontier.spent(bucket, today()):,}/{limit(self.profile, bucket):,}")


def _with(params: dict[str, Any], **more: Any) -> dict[str, Any]:
    return params | {name: value for name, value in more.items() if value is not None}


def _as_stop(error: BaseException) -> KbError:
    if isinstance(error, OSError):
        from kb.core.errors import FatalError

        return FatalError(str(error))
    failure = KbError(f"unexpected {type(error).__name__} in a transcript's thread: {error}", hint="run it again with --debug")
    failure.__cause__ = error
    return failure
