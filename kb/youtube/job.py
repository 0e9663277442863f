"""What the lanes of one crawl share: frontier, recorder, the summary, what the limit counts, the progress bars."""

from __future__ import annotations

import threading
from typing import Any

from kb.core import vocabulary
from kb.core.context import Run
from kb.core.errors import LimitReached
from kb.core.verdict import Summary
from kb.store.frontier import Frontier
from kb.store.recorder import Recorder
from kb.youtube import effects
from kb.youtube.effects import CHANNELS, SEARCHES, TRANSCRIPTS, UPLOADS, VIDEOS
from kb.youtube.quota import GENERAL, SEARCH, limit, today

PACK = 50  # ids a call, and entries a page: the API's largest
NAMES = {VIDEOS: "metadata"}
UNITS = {SEARCHES: "pages", UPLOADS: "pages"}


class Job:
    """One run over the frontier. Its methods may be called from every thread; `lock` guards the summary."""

    def __init__(self, run: Run, frontier: Frontier, recorder: Recorder, phases: set[str]) -> None:
        self.run, self.frontier, self.recorder, self.phases = run, frontier, recorder, phases
        self.profile = run.profile.section("youtube")
        self.summary = Summary(
            command="youtube crawl",
            source="youtube",
            counted="videos",
            crawled=0,
            crawled_in_all=0,
            missing=0,
            failed=0,
            pending=0,
            channels=0,
            transcripts_asked=0,
            transcripts=0,
            requests=0,
            units=0,
            bad_lines=0,
            left=0,
            left_by={},
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

    def show(self, phase: str, n: int = 1) -> None:
        """`n` items of a phase are done: its progress bar, with the quota that it spends."""
        with self.lock:
            if phase not in self._tasks:
                self._tasks[phase] = self.run.progress.task(
                    NAMES.get(phase, phase),
                    self.run.limit if phase == self.counts else None,
                    UNITS.get(phase, "videos"),
                    waiting=lambda: self.frontier.waiting(phase),
                )
            task = self._tasks[phase]
        if phase == TRANSCRIPTS:
            task.advance(n)
        else:
            bucket = SEARCH if phase == SEARCHES else GENERAL
            task.advance(
                n, quota=f"{self.frontier.spent(bucket, today()):,}/{limit(self.profile, bucket):,}"
            )

    def count(self) -> Summary:
        """The summary with what was asked, what failed and what is left."""
        requests, units = self.frontier.requests()
        kinds = self.frontier.kinds()
        counts = [kinds.get(kind, {}) for kind in self.phases]
        left = vocabulary.left_by("youtube", {kind: kinds.get(kind, {}) for kind in self.phases})
        in_all = effects.crawled(self.frontier)
        self.summary |= {
            "requests": requests - self._start[0],
            "units": units - self._start[1],
            "failed": sum(count.get("error", 0) for count in counts),
            "crawled_in_all": in_all,
            "pending": self.frontier.waiting(VIDEOS),
            "channels": kinds.get(CHANNELS, {}).get("done", 0),
            "left": sum(left.values()),
            "left_by": left,
        }
        return self.summary

    def close(self, *, stopped: bool) -> None:
        """End the progress bars; those of a run that was stopped stay partial."""
        for task in self._tasks.values():
            task.close(stopped=stopped)
