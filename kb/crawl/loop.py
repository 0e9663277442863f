"""The one loop: phases side by side and one after the other, until nothing is left or something
stops.

    a lane     threads that work on the phases of one service, nearest to a whole item first
    a stop     (quota spent, blocked, limit) closes what it concerns; the other phases go on
    an error   that is no stop, a full disk or a signal ends all lanes after the items in hand

What an error means for the items in hand is decided here, by its class, for every source alike;
whose turn it is, in kb.crawl.turns.
"""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from kb.core import clock, signals
from kb.core.errors import (
    Blocked,
    DiskFull,
    Interrupted,
    ItemFinal,
    Retryable,
    Stopped,
    Unreachable,
)
from kb.core.progress import Task
from kb.crawl.limits import worst
from kb.crawl.session import CrawlSession
from kb.crawl.source import Phase
from kb.crawl.turns import Turn, Turns
from kb.store.state.frontier import Item

_EVERYTHING = (DiskFull, Interrupted)  # stops that are not one service's matter


@dataclass
class Tried:
    """What became of a kind's items in a run: how many were asked for, how many of these for the
    first time; how many failed and how many can't be read for good, by reason.
    """

    n: int = 0
    first: int = 0
    failed: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)

    @property
    def read(self) -> int:
        """How many were read."""
        return self.n - self.failed.total() - self.skipped.total()


class Loop:
    """One run over the frontier. `answered` counts, by kind, the items that were answered or
    failed.

    `facts` gives the figures that a phase's progress bar shows beside its count.
    """

    def __init__(
        self,
        session: CrawlSession,
        phases: Sequence[Phase] | None = None,
        *,
        facts: Callable[[Phase], dict[str, object]] | None = None,
    ) -> None:
        self.session, self.frontier, self.source = session, session.frontier, session.source
        self.turns = Turns(session, session.source.phases if phases is None else phases)
        self.answered: Counter[str] = Counter()
        self.tried: defaultdict[str, Tried] = defaultdict(Tried)  # by kind
        self._facts = facts or (lambda phase: {})
        self._changed = threading.Condition()
        self._end: BaseException | None = None  # why everything ends
        self._failures: Counter[str] = Counter()  # in a row, by lane
        self._up: set[str] = set()  # lanes that had an answer in this run
        self._doubtful: dict[str, tuple[Phase, Retryable]] = {}  # the last failure of the others
        self._bars: dict[str, Task] = {}

    def run(self) -> None:
        """Work until nothing is left. Raises the reason when something is left that could be done.

        The first lane works in the caller's thread, which is the one that hears of signals.
        """
        self.turns.begin()
        lanes = self.turns.lanes()
        threads = [
            threading.Thread(target=self._work, args=(lane,), name=f"{lane}-{number}")
            for lane in lanes
            for number in range(self._threads(lane))
            if (lane, number) != (lanes[0], 0)
        ]
        for thread in threads:
            thread.start()
        try:
            if lanes:
                self._work(lanes[0])
        finally:
            for thread in threads:
                thread.join()
            self._look_at_silent_lanes()
            self.turns.end()
            stopped = self._end is not None or bool(self.turns.stops())
            for bar in self._bars.values():
                bar.close(stopped=stopped)
        if self._end is not None:
            raise self._end
        stop = worst(self.turns.stops())
        if stop is not None:
            raise stop

    def _look_at_silent_lanes(self) -> None:
        """A lane that had not one answer and too few failures to tell: is its service down?

        All has been tried by now, so whatever the service has ever answered may tell.
        """
        for phase, failure in self._doubtful.values():
            if self._end is not None or self.turns.stops():
                return
            known = self.turns.answered(phase.lane)
            if known is None or not self._answers(*known):
                self._stop(phase, _down(failure), 0)

    def _threads(self, lane: str) -> int:
        return max(phase.workers for phase in self.turns.phases if phase.lane == lane)

    # -- one thread --------------------------------------------------------------------------------

    def _work(self, lane: str) -> None:
        """One thread's part of a lane."""
        try:
            while True:
                signals.stop.check()
                turn = self._wait_for_turn(lane)
                if turn is None:
                    return
                try:
                    self._ask(*turn)
                finally:
                    with self._changed:
                        self.turns.done(turn[0])
                        self._changed.notify_all()
        except BaseException as error:  # noqa: BLE001  raised again by the thread that called run
            self._end_all(error)
        finally:
            with self._changed:
                self._changed.notify_all()

    def _wait_for_turn(self, lane: str) -> Turn | None:
        """The next items of a lane; None when nothing is left for it in this run."""
        while True:
            with self._changed:
                if self._end is not None:
                    return None
                turn = self.turns.take(lane)
                if turn is not None:
                    return turn
                if self.turns.may_come(lane):
                    self._changed.wait(timeout=0.2)
                    signals.stop.check()
                    continue
                back, why = self.turns.back(lane), self.turns.why(lane)
                if back is None:
                    return None
            self._sleep(lane, back, why)

    def _sleep(self, lane: str, back: datetime, why: Stopped | None) -> None:
        """Wait until the service answers again, then open what its stop had closed."""
        said = f"{self.source.name}: waiting until {clock.stamp(back)}"
        if isinstance(why, Blocked) and why.after is not None:
            said = f"waiting {why.after:.0f} s: {why}"
        self.session.run.progress.say(said)
        clock.sleep_until(back)
        self.session.goes_on(lane)
        with self._changed:
            self.turns.reopen(lane)

    # -- what became of it -------------------------------------------------------------------------

    def _ask(self, phase: Phase, items: list[Item]) -> None:
        """Fetch and record items, and look whether the service is down where that failed."""
        failure = self._fetch(phase, items)
        if failure is None:
            return
        with self._changed:
            self._failures[phase.lane] += 1
            doubtful = failure.unreachable or self._failures[phase.lane] >= phase.down
            if doubtful:
                self._failures[phase.lane] = 0  # other threads go on meanwhile
        if doubtful and not self._is_up(phase):
            self._stop(phase, _down(failure), 0)

    def _is_up(self, phase: Phase) -> bool:
        """Whether the service answers for an item that did not fail before.

        Best is one that it has answered already: that is asked for again and nothing recorded.
        Where a service has answered nothing yet, another item has to do.
        """
        known = self.turns.answered(phase.lane, phase)
        if known is not None:
            return self._answers(*known)
        with self._changed:
            another = self.turns.another(phase)
        return bool(another) and self._fetch(phase, another) is None

    def _answers(self, phase: Phase, item: Item) -> bool:
        try:
            answer = next(iter(self.source.fetch(phase, [item])), None)
        except ItemFinal:
            return True
        except Retryable:
            return False
        except BaseException as error:  # noqa: BLE001  kept as the reason to end
            self._stop(phase, error, 0)
            return True
        return answer is None or answer.failed is None

    def _fetch(self, phase: Phase, items: list[Item]) -> Retryable | None:
        """Fetch and record items; an error by its consequence. The failure, when it was one."""
        failure: Retryable | None = None
        whole = True
        try:
            for answer in self.source.fetch(phase, items):
                self.session.record(answer)
                if answer.failed is not None:
                    failure = Retryable(answer.failed)
                whole = whole and answer.whole
        except ItemFinal as fact:
            self.frontier.mark(phase.kind, self._unanswered(phase, items), "skipped", fact.reason)
        except Retryable as error:
            failure = error
        except BaseException as error:  # noqa: BLE001  kept as the reason to end
            # Another item finds out whether a block is over: one may be refused for ever.
            refused = isinstance(error, Blocked)
            self.frontier.release(phase.kind, *self._unanswered(phase, items), last=refused)
            self._stop(phase, error, len(items))
            return None
        self._settle(phase, items, failure, whole)
        return failure

    def _settle(
        self, phase: Phase, items: list[Item], failure: Retryable | None, whole: bool
    ) -> None:
        """Items were answered or failed; a batch that failed is asked for in halves."""
        left = self._unanswered(phase, items)
        if failure is not None and len(left) > 1:
            again = [item for item in items if item.key in left]
            with self._changed:
                self.turns.split(phase, again, failure.reason)
                self._changed.notify_all()
            items = [item for item in items if item.key not in left]
        elif left:
            reason = "unanswered" if failure is None else failure.reason
            self.frontier.mark(phase.kind, left, "error", reason)
        states = [self.frontier.get(phase.kind, item.key) for item in items]
        with self._changed:
            self.answered[phase.kind] += len(items)
            tried = self.tried[phase.kind]
            tried.n += len(items)
            tried.first += sum(not item.failed for item in items)
            for status, _, code in filter(None, states):
                if status in ("error", "skipped"):
                    why = tried.failed if status == "error" else tried.skipped
                    why[code or status] += 1
            if failure is None:
                self._failures[phase.lane] = 0
                self._doubtful.pop(phase.lane, None)
                self._up.add(phase.lane)
            elif phase.lane not in self._up:
                self._doubtful[phase.lane] = phase, failure
        if failure is None and whole:
            self.session.let_in(phase.lane)
        self._show(phase, len(items))

    def _unanswered(self, phase: Phase, items: list[Item]) -> list[str]:
        states = ((item.key, self.frontier.get(phase.kind, item.key)) for item in items)
        return [key for key, state in states if state is not None and state[0] == "in_progress"]

    def _stop(self, phase: Phase, error: BaseException, given_back: int) -> None:
        """Close what a stop concerns; anything else ends the run."""
        with self._changed:
            self.turns.give_back(phase, given_back)
        if not isinstance(error, Stopped) or isinstance(error, _EVERYTHING):
            self._end_all(error)
            return
        if isinstance(error, Blocked):
            self.session.turned_away(phase.lane)
        if isinstance(error, (Blocked, Unreachable)):
            self.session.ended(phase.lane, error)
        with self._changed:
            self.turns.close(phase, error)
            self._changed.notify_all()

    def _end_all(self, error: BaseException) -> None:
        """The run ends: threads finish what they have in hand, or stop waiting for it."""
        for lane in self.turns.lanes():
            self.session.ended(lane, error)
        with self._changed:
            self._end = self._end or error
            self._changed.notify_all()

    def _show(self, phase: Phase, n: int) -> None:
        if not phase.shown:
            return
        with self._changed:
            bar = self._bars.get(phase.kind)
            if bar is None:
                bar = self._bars[phase.kind] = self.session.run.progress.task(
                    phase.name or phase.kind,
                    self.session.run.limit if phase.limited else None,
                    phase.unit,
                    waiting=lambda: self.frontier.waiting(phase.kind),
                )
        bar.advance(n, **self._facts(phase))


def _down(failure: Retryable) -> Unreachable:
    if failure.unreachable:
        return Unreachable(
            f"no connection: {failure.reason}",
            hint="check the network; the same command resumes",
        )
    return Unreachable(
        f"{failure.reason}; no other item was answered either",
        hint="the service seems to be down; the same command resumes",
    )
