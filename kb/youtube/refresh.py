"""Read again what is older than the profile allows: data that is not refreshed should go, say
the terms of YouTube's API.

Newer answers win when filtering; a video that is no longer returned becomes `missing`, and
`kb purge youtube` removes it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from datetime import timedelta
from pathlib import Path

import msgspec

from kb.core import clock, waiting
from kb.core.context import Run
from kb.core.plan import Phase as Step
from kb.core.plan import plan
from kb.core.profile.youtube import YouTube as Profile
from kb.core.verdict import Summary
from kb.crawl.job import work
from kb.crawl.loop import Loop
from kb.crawl.session import Session
from kb.crawl.source import Opened, Phase
from kb.store import rawlog, tombstones
from kb.store.frontier import ROUND, Frontier, going_on
from kb.youtube import parse
from kb.youtube.fetch import API, PACK
from kb.youtube.quota import GENERAL
from kb.youtube.reduce import RAW_VIDEOS, REFRESH
from kb.youtube.source import YouTube

BYTES_A_CALL = 60_000  # compressed, of 50 videos
READ = Phase(
    kind=REFRESH,
    unit="videos",
    name="refresh",
    batch=PACK,
    lane=API,
    bucket=GENERAL,
    limited=True,
)


class _Head(msgspec.Struct):
    """Of an envelope, when and what was asked; the answer itself is not decoded."""

    fetched_at: str
    request: rawlog.Request


def newest(root: Path) -> dict[str, str]:
    """When each video was last asked for, by id."""
    decoder = msgspec.json.Decoder(_Head)
    times: dict[str, str] = {}
    for path in rawlog.segments(root, "youtube", RAW_VIDEOS):
        for _, line in rawlog.Frames(path):
            head = decoder.decode(line)
            for key in parse.requested(head.request.params):
                if times.get(key, "") < head.fetched_at:
                    times[key] = head.fetched_at
    return times


def plan_refresh(run: Run, older_than: int | None = None) -> Summary:
    """What a refresh would read again now, and its units. Sends and writes nothing."""
    purged = tombstones.keys(run.root, "youtube")
    old = len(_old(run, run.profile.section("youtube"), purged, older_than))
    calls = math.ceil(old / PACK)
    gb = calls * BYTES_A_CALL / 1e9
    phase = Step("videos to refresh", old, requests=calls, units=calls, gb=gb)
    assumed = [f"{BYTES_A_CALL // 1000} kB a call of {PACK} videos"]
    return Summary(plan("refresh youtube", "youtube", [phase], assumed))


def _old(run: Run, profile: Profile, purged: Collection[str], older_than: int | None) -> list[str]:
    """Ids of videos whose newest answer is older than so many days, or than `profile` allows."""
    days = profile.max_age_days if older_than is None else older_than
    oldest = clock.now() - timedelta(days=days)
    return [
        key
        for key, at in newest(run.root).items()
        # With 0 days also what was read in this very second.
        if (clock.parse(at) < oldest or older_than == 0) and key not in purged
    ]


def refresh(run: Run, older_than: int | None = None) -> Summary:
    """Read the metadata of every video again whose newest answer is older than `max_age_days`.

    `older_than` days count instead (0: everything). What it found due is kept until it is read, so
    the same command goes on where it stopped. One unit for 50 videos. Raises Stopped with `summary`
    when something is left.
    """
    source = Refresh(run, older_than)
    return work(run, source, source.summary, phases=source.chosen, facts=source.facts)


class Refresh(YouTube):
    """The videos that are due. Nothing is asked of the web site: transcripts don't age."""

    def __init__(self, run: Run, older_than: int | None) -> None:
        super().__init__(run)
        self.chosen = [READ]
        self._older_than, self._goes_on = older_than, False

    def begin(self, opened: Opened) -> None:
        """See whether a refresh was stopped, before what has failed is opened again."""
        super().begin(opened)
        self._goes_on = going_on(opened.frontier, REFRESH, self._older_than)

    def discover(self, frontier: Frontier) -> None:
        """What is due, unless the last refresh has left something."""
        if not self._goes_on:
            old = _old(self.run, self.profile, self.opened.gone, self._older_than)
            with frontier.transaction():
                frontier.replace(REFRESH, old)
                frontier.set_cursor(ROUND, self._older_than)
        if not frontier.ready(REFRESH):
            days = self.profile.max_age_days if self._older_than is None else self._older_than
            self.run.progress.say(f"youtube: nothing is older than {days} days")

    def summary(self, session: Session, loop: Loop) -> Summary:
        """What was read again, and what is left."""
        left = waiting.left_by("youtube", {REFRESH: session.frontier.counts(REFRESH)})
        asked = self.of_known("refresh youtube", session, REFRESH)
        return Summary(asked, left=sum(left.values()), left_by=left)
