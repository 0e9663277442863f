"""The lane of the Data API: searches → uploads → videos, always the phase nearest to the end that has enough to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from kb.core import clock, signals
from kb.core.errors import ItemFinal, QuotaSpent, Retryable
from kb.store.frontier import Item
from kb.youtube import effects, parse
from kb.youtube.api import Api
from kb.youtube.effects import SEARCHES, UPLOADS, VIDEOS
from kb.youtube.job import PACK, Job

PARTS = "snippet,contentDetails,statistics,status,player"
FRAME = {"maxWidth": 1920, "maxHeight": 1080}  # of the embed: its shape is the video's
ASKED = {SEARCHES, UPLOADS, VIDEOS}


class ApiLane:
    """`wake` is called when videos were read, because their transcripts may be wanted."""

    def __init__(self, job: Job, wake: Callable[[], None]) -> None:
        self.job, self.frontier, self._wake = job, job.frontier, wake
        self._phases = job.phases & ASKED

    def work(self) -> None:
        """Until nothing is left to ask. Raises QuotaSpent, LimitReached and what the API's client raises."""
        if not self._phases:
            return
        spent: dict[str, QuotaSpent] = {}  # by phase: what to say in the end
        if any(self.frontier.ready(kind) for kind in self._phases):
            api = Api(
                self.job.run.settings, self.job.profile, self.frontier, wait=self.job.run.wait
            )
            try:
                self._ask_all(api, spent)
            finally:
                api.close()
        if spent:
            raise next(iter(spent.values()))
        if self.job.room() <= 0:
            raise self.job.limit_reached()

    def _ask_all(self, api: Api, spent: dict[str, QuotaSpent]) -> None:
        steps = {SEARCHES: self._search, UPLOADS: self._list, VIDEOS: self._read}
        while True:
            signals.stop.check()
            step = self._next_step(spent)
            if step is None:
                if not (spent and self.job.run.wait):
                    return
                self._sleep_until_reset(spent)
                continue
            try:
                steps[step](api)
            except QuotaSpent as stop:
                spent |= {SEARCHES: stop} if step == SEARCHES else {UPLOADS: stop, VIDEOS: stop}

    def _next_step(self, spent: dict[str, QuotaSpent]) -> str | None:
        """The phase whose turn it is; None when none has quota, room and something to do."""
        open_phases = {
            kind for kind in self._phases if kind not in spent and self.frontier.ready(kind)
        }
        wanted = min(PACK, self.job.room())
        if wanted <= 0:
            return None
        packed = VIDEOS in open_phases and self.frontier.ready(VIDEOS, PACK) >= wanted
        if packed or open_phases == {VIDEOS}:
            return VIDEOS
        return next((kind for kind in (UPLOADS, SEARCHES) if kind in open_phases), None)

    def _search(self, api: Api) -> None:
        (item,) = self.frontier.take(SEARCHES, 1)
        if item.payload["page"] > self.job.profile.search_pages:
            self.frontier.skip(SEARCHES, item.key, effects.BEYOND)
            return
        params = {
            "q": item.payload["q"],
            "type": "channel",
            "part": "snippet",
            "maxResults": PACK,
            **_page(item),
        }
        answer = self._ask([item], lambda: api.search(**params))
        if answer is not None:
            self.job.recorder.record(effects.RAW_SEARCH, "search.list", params, 200, answer)
            self._done(SEARCHES)

    def _list(self, api: Api) -> None:
        (item,) = self.frontier.take(UPLOADS, 1)
        params = {
            "playlistId": item.payload["playlist"],
            "part": "contentDetails",
            "maxResults": PACK,
            **_page(item),
        }
        try:
            answer = self._ask([item], lambda: api.playlist_items(**params), facts=True)
        except ItemFinal as fact:
            if fact.reason != "not_found":
                self.frontier.skip(UPLOADS, item.key, fact.reason)
                return
            self.job.recorder.record(
                effects.RAW_LIST, "playlistItems.list", params, 404, {"error": {"code": 404}}
            )
            return
        if answer is not None:
            self.job.recorder.record(effects.RAW_LIST, "playlistItems.list", params, 200, answer)
            self._done(UPLOADS)

    def _read(self, api: Api) -> None:
        items = self.frontier.take(VIDEOS, min(PACK, self.job.room()))
        params = {"id": ",".join(item.key for item in items), "part": PARTS, **FRAME}
        answer = self._ask(items, lambda: api.videos(**params))
        if answer is None:
            return
        self.job.recorder.record(effects.RAW_VIDEOS, "videos.list", params, 200, answer)
        with self.job.lock:
            self.job.summary["crawled"] += len(items)
            self.job.summary["missing"] += len(parse.missing(params, answer))
        self._done(VIDEOS, len(items))
        self._wake()

    def _done(self, phase: str, n: int = 1) -> None:
        if phase == self.job.counts:
            self.job.spend_room(n)
        self.job.show(phase, n)

    def _ask(
        self, items: list[Item], call: Callable[[], dict[str, Any]], *, facts: bool = False
    ) -> dict[str, Any] | None:
        """The answer; None when the items failed. What stops the run gives them back first.

        Only a list can be final (`facts`: ItemFinal is raised): a search or a pack of videos that is refused fails.
        """
        kind, keys = items[0].kind, [item.key for item in items]
        try:
            return call()
        except (Retryable, ItemFinal) as error:
            if facts and isinstance(error, ItemFinal):
                raise
            self.frontier.mark(kind, keys, "error", error.reason)
            return None
        except BaseException:
            self.frontier.release(kind, *keys)
            raise

    def _sleep_until_reset(self, spent: dict[str, QuotaSpent]) -> None:
        reset = min(stop.reset_at for stop in spent.values() if stop.reset_at)
        self.job.run.progress.say(f"youtube: quota spent; waiting until {clock.stamp(reset)}")
        clock.sleep_until(reset)
        spent.clear()


def _page(item: Item) -> dict[str, str]:
    return {"pageToken": item.payload["token"]} if item.payload["token"] is not None else {}
