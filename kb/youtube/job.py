"""What the lanes of one crawl share: frontier, recorder, the summary, what the limit counts, the progress bars."""

from __future__ import annotations

import threading
from typing import Any

from kb.core.context import Run
from kb.core.errors import LimitReached
from kb.core.verdict import Summary
from kb.store.frontier import Frontier
from kb.store.recorder import Recorder
from kb.youtube.effects import SEARCHES, TRANSCRIPTS, VIDEOS
from kb.youtube.quota import GENERAL, SEARCH, limit, today

PACK = 50  # ids a call, and entries a page: the API's largest
NAMES = {VIDEOS: "metadata"}


class Job:
    """One run over the frontier. Its methods may be called from every thread; `lock` guards the summary."""

    def __init__(self, run: Run, frontier: Frontier, recorder: Recorder, phases: set[str]) -> None:
        self.run, self.frontier, self.recorder, self.phases = run, frontier, recorder, phases
        self.profile = run.profile.section("youtube")
        self.summary = Summary(
            crawled=0, transcripts=0, failed=0, missing=0, requests=0, units=0, bad_lines=0, left=0
        )
        self.lock = threading.RLock()
        # What the limit counts: videos, or what the one phase handles that --only names.
        self.counts = VIDEOS if VIDEOS in phases else next(iter(phases))
        self._counted = 0
        self._start = frontier.requests()
        self._tasks: dict[str, Any] = {}

    def room(self) -> int:
        """How many more items the limit allows; a pack of them without a limit."""
        return PACK if self.run.limit is None else self.run.limit - self._counted

    def spend_room(self, n: int) -> None:
        """`n` more items are being handled of what the limit counts."""
        with self.lock:
            self._counted += n

    def limit_reached(self) -> LimitReached:
        """The reason to stop when there is no room."""
        return LimitReached(
            f"--limit {self.run.limit} reached", hint="run the same command to go on"
        )

    def show(self, phase: str, unit: str, n: int = 1) -> None:
        """`n` items of a phase are done: its progress bar, with the quota that it spends."""
        with self.lock:
            if phase not in self._tasks:
                self._tasks[phase] = self.run.progress.task(NAMES.get(phase, phase), unit=unit)
            task = self._tasks[phase]
        if phase == TRANSCRIPTS:
            task.advance(n, waiting=self.frontier.ready(TRANSCRIPTS, 10_000))
        else:
            bucket = SEARCH if phase == SEARCHES else GENERAL
            task.advance(
                n, quota=f"{self.frontier.spent(bucket, today()):,}/{limit(self.profile, bucket):,}"
            )

    def count(self) -> Summary:
        """The summary with what was asked, what failed and what is left."""
        requests, units = self.frontier.requests()
        counts = [self.frontier.counts(kind) for kind in self.phases]
        self.summary |= {
            "requests": requests - self._start[0],
            "units": units - self._start[1],
            "failed": sum(count.get("error", 0) for count in counts),
            "left": sum(count.get("todo", 0) for count in counts),
        }
        return self.summary

    def close(self) -> None:
        """End the progress bars."""
        for task in self._tasks.values():
            task.close()
