"""The lane of the web site: transcripts, one after the other in each of a few threads, at a pace that the site bears."""

from __future__ import annotations

import threading

from kb.core import clock, signals
from kb.core.errors import Blocked, FatalError, KbError, LimitReached, Retryable, Unreachable
from kb.net.rate import Pace
from kb.store.frontier import Item
from kb.youtube import effects
from kb.youtube.effects import TRANSCRIPTS
from kb.youtube.job import Job
from kb.youtube.quota import WEB
from kb.youtube.transcripts import Fetcher

BLOCKED = "web_blocked"  # cursor: since when the site turns us away
HOPELESS = (
    6  # so many transcripts failed one after the other: the site is in trouble, not the video
)


class WebLane:
    """`stop` is why the lane ended, None while it goes on or when nothing was left.

    After a block one video alone finds out whether it still stands; the other threads begin when it was answered.
    """

    def __init__(self, job: Job, pace: Pace) -> None:
        self.job, self.frontier, self._pace = job, job.frontier, pace
        self.stop: KbError | None = None
        self._news = threading.Condition()
        self._no_more = False
        self._bad_luck = 0
        self._probing = self.frontier.cursor(BLOCKED) is not None
        self._in_hand = 0

    def work(self) -> None:
        """One thread's part: until nothing is left and nothing can come, or a reason to stop was found."""
        job = self.job
        fetcher = Fetcher(
            job.run.settings,
            job.profile,
            self._pace,
            self._before,
            sleep=self._sleep,
            wait=job.run.wait,
        )
        try:
            while self.stop is None:
                signals.stop.check()
                item = self._take()
                if item is not None:
                    self._transcript(fetcher, item)
                elif self._no_more and not self.frontier.ready(TRANSCRIPTS):
                    return
                else:
                    with self._news:
                        self._news.wait(timeout=0.2)
        except KbError as stop:
            if isinstance(stop, Blocked):
                self.frontier.set_cursor(BLOCKED, clock.stamp())
            self.end(stop)
        except BaseException as error:  # noqa: BLE001  a thread's error must reach the run
            self.end(_as_stop(error))
        finally:
            fetcher.close()

    def end(self, stop: KbError) -> None:
        """All threads end; the first reason is the one that is told. After a limit they finish what they have in hand."""
        with self.job.lock:
            self.stop = self.stop or stop
        self.wake()

    def no_more(self) -> None:
        """The API lane has ended: what is not on the frontier now won't come."""
        self._no_more = True
        self.wake()

    def wake(self) -> None:
        """Look at the frontier now."""
        with self._news:
            self._news.notify_all()

    def _before(self, endpoint: str) -> None:
        """Before each request: the ledger. Raises Blocked when another thread met it."""
        if isinstance(self.stop, Blocked):
            raise self.stop
        self.frontier.spend(WEB, 0, endpoint)

    def _sleep(self, seconds: float) -> None:
        """Between two tries. Raises what stops the lane meanwhile, but for a limit."""
        while seconds > 0:
            if self.stop is not None and not isinstance(self.stop, LimitReached):
                raise self.stop
            step = min(seconds, 0.5)
            clock.sleep(step)
            seconds -= step

    def _take(self) -> Item | None:
        """The next video. Raises LimitReached when transcripts are what the limit counts."""
        counted = self.job.counts == TRANSCRIPTS
        with self.job.lock:
            if self._probing and self._in_hand:
                return None
            if counted and self.job.room() <= 0:
                raise self.job.limit_reached()
            items = self.frontier.take(TRANSCRIPTS, 1)
            if counted:
                self.job.spend_room(len(items))
            self._in_hand += len(items)
        return items[0] if items else None

    def _transcript(self, fetcher: Fetcher, item: Item) -> None:
        try:
            found = fetcher.fetch(item.key, probe=self._probing and not self.job.run.wait)
        except Retryable as error:
            found = {"video_id": item.key, "outcome": "failed", "reason": error.reason}
        except BaseException:
            self.frontier.release(TRANSCRIPTS, item.key)
            raise
        finally:
            with self.job.lock:
                self._in_hand -= 1
        params = {"video_id": item.key, "language": self.job.profile.language}
        self.job.recorder.record(effects.RAW_TRANSCRIPTS, "transcript", params, 200, found)
        with self.job.lock:
            self.job.summary["transcripts"] += found["outcome"] == "ok"
            self.job.summary["transcripts_asked"] += found["outcome"] != "failed"
            self._bad_luck = self._bad_luck + 1 if found["outcome"] == "failed" else 0
            if self._probing and found["outcome"] == "ok":  # all its requests went well
                self._probing = False
                self.frontier.set_cursor(BLOCKED, None)
        self.job.show(TRANSCRIPTS)
        if self._bad_luck >= HOPELESS:
            raise Unreachable(
                f"{found['reason']}; {self._bad_luck} transcripts failed one after the other",
                hint="the site seems to be in trouble; the same command goes on",
            )


def _as_stop(error: BaseException) -> KbError:
    if isinstance(error, OSError):
        return FatalError(str(error))
    failure = KbError(
        f"unexpected {type(error).__name__} in a transcript's thread: {error}",
        hint="run it again with --debug",
    )
    failure.__cause__ = error
    return failure
