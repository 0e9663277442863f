"""The one loop: phases side by side and one after the other, until nothing is left or something
stops.

    a lane     threads that work on the phases of one service, nearest to a whole item first
    a stop     (quota spent, blocked, limit) closes what it concerns; the other phases go on
    an error   that is no stop, a full disk or a signal ends all lanes after the items in hand

What an error means for the items in hand is decided here, by its class, for every source alike.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from kb.core import clock, signals
from kb.core.errors import (
    Blocked,
    DiskFull,
    Interrupted,
    ItemFinal,
    LimitReached,
    QuotaSpent,
    Retryable,
    Stopped,
    Unreachable,
)
from kb.crawl.limits import Limit, back_at, together, upstream, worst
from kb.crawl.session import Session
from kb.crawl.source import Phase
from kb.store.frontier import Item

Turn = tuple[Phase, list[Item]]
_EVERYTHING = (DiskFull, Interrupted)  # stops that are not one service's matter


class Loop:
    """One run over the frontier. `answered` counts, by kind, the items that were answered or
    failed.

    `facts` gives the figures that a phase's progress bar shows beside its count.
    """

    def __init__(
        self,
        session: Session,
        phases: Sequence[Phase] | None = None,
        *,
        facts: Callable[[Phase], dict[str, object]] | None = None,
    ) -> None:
        self.session, self.frontier, self.source = session, session.frontier, session.source
        self.phases = list(session.source.phases if phases is None else phases)
        self.answered: Counter[str] = Counter()
        self._facts = facts or (lambda phase: {})
        self._limit = Limit(session.run.limit)
        self._changed = threading.Condition()
        self._in_hand: Counter[str] = Counter()  # fetches by kind
        self._closed: dict[str, Stopped] = {}  # kind: why nothing more is asked of it
        self._end: BaseException | None = None  # why everything ends
        self._failures: Counter[str] = Counter()  # in a row, by lane
        self._bars: dict[str, Any] = {}
        self._lanes = {phase.kind: phase.lane for phase in self.phases}
        self._above = {
            phase.kind: upstream(self.phases, phase.kind) & {one.kind for one in self.phases}
            for phase in self.phases
        }

    def run(self) -> None:
        """Work until nothing is left. Raises the reason when something is left that could be done.

        The first lane works in the caller's thread, which is the one that hears of signals.
        """
        lanes = list(dict.fromkeys(phase.lane for phase in self.phases))
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
            stopped = self._end is not None or bool(self._stops())
            for bar in self._bars.values():
                bar.close(stopped=stopped)
        if self._end is not None:
            raise self._end
        stop = worst(self._stops())
        if stop is not None:
            raise stop

    def left(self, kind: str) -> int:
        """How many items of a kind wait for another run."""
        counts = self.frontier.counts(kind)
        return counts.get("todo", 0) + counts.get("in_progress", 0)

    def _stops(self) -> list[Stopped]:
        """Why something is left. A limit that took all there was is no reason.

        Of a service that is down nothing may wait any more: the last items have failed.
        """
        return [
            stop
            for kind, stop in self._closed.items()
            if self.left(kind) or isinstance(stop, Unreachable)
        ]

    def _threads(self, lane: str) -> int:
        return max(phase.workers for phase in self.phases if phase.lane == lane)

    # -- whose turn it is --------------------------------------------------------------------------

    def _work(self, lane: str) -> None:
        """One thread's part of a lane."""
        try:
            while True:
                signals.stop.check()
                turn = self._wait_for_turn(lane)
                if turn is None:
                    return
                self._answer(*turn)
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
                turn = self._take(lane)
                if turn is not None:
                    return turn
                if self._may_come(lane):
                    self._changed.wait(timeout=0.2)
                    signals.stop.check()
                    continue
                back = self._back(lane)
                if back is None:
                    return None
            self._sleep(lane, back)

    def _take(self, lane: str) -> Turn | None:
        if self.session.probing(lane) and any(
            self._in_hand[phase.kind] for phase in self.phases if phase.lane == lane
        ):
            return None
        self._close_what_is_limited()
        for phase in self.phases:
            if phase.lane != lane or not self._open(phase):
                continue
            turn = self._take_of(phase)
            if turn is not None:
                return turn
        return None

    def _close_what_is_limited(self) -> None:
        """As many were answered as the limit allows: nothing more is listed for them either."""
        for phase in self.phases:
            if not phase.limited or phase.seeks or self._in_hand[phase.kind]:
                continue
            if self._limit.room(1) <= 0:
                self._close(phase, self._limit.reached())

    def _open(self, phase: Phase) -> bool:
        """Whether a phase may be worked on now, as far as the others are concerned."""
        if phase.kind in self._closed or self._in_hand[phase.kind] >= phase.workers:
            return False
        return not (phase.whole and any(self._busy(kind) for kind in self._above[phase.kind]))

    def _take_of(self, phase: Phase) -> Turn | None:
        """Items of a phase, without those that the source leaves out."""
        while self.frontier.ready(phase.kind):
            room = self._limit.room(phase.batch) if phase.limited else phase.batch
            if phase.packed and self.frontier.ready(phase.kind, room) < room and self._more(phase):
                return None
            # What is left out takes nothing of the limit, so it is looked for beyond it too.
            items = self._wanted(phase, self.frontier.take(phase.kind, max(room, 1)))
            if not items:
                continue
            if room <= 0:
                self.frontier.release(phase.kind, *(item.key for item in items))
                self._close(phase, self._limit.reached())
                return None
            chosen = self.source.pack(phase, items)
            keys = {item.key for item in chosen}
            self.frontier.release(phase.kind, *(item.key for item in items if item.key not in keys))
            self._in_hand[phase.kind] += 1
            if phase.limited:
                self._limit.take(len(chosen))
            return phase, chosen
        return None

    def _wanted(self, phase: Phase, items: list[Item]) -> list[Item]:
        wanted = []
        for item in items:
            reason = self.source.leave_out(phase, item)
            if reason is None:
                wanted.append(item)
            else:
                self.frontier.skip(phase.kind, item.key, reason)
        return wanted

    def _busy(self, kind: str) -> bool:
        """Whether a phase has items in hand, or some that this run will take."""
        if self._in_hand[kind]:
            return True
        return kind not in self._closed and bool(self.frontier.ready(kind))

    def _more(self, phase: Phase) -> bool:
        """Whether the phase's own lane can be asked for more of its items first."""
        own = {one.kind for one in self.phases if one.lane == phase.lane}
        return any(self._busy(kind) for kind in self._above[phase.kind] & own)

    def _may_come(self, lane: str) -> bool:
        """Whether a thread of this lane should wait for what is in hand, here or above."""
        for phase in self.phases:
            if phase.lane != lane or phase.kind in self._closed:
                continue
            above = self._above[phase.kind]
            if self._in_hand[phase.kind] or any(map(self._busy, above)):
                return True
            if any(self._sleeps(kind) for kind in above if self._lanes[kind] != lane):
                return True
        return False

    def _sleeps(self, kind: str) -> bool:
        """Whether a phase was stopped and its lane waits until it may go on."""
        stop = self._closed.get(kind)
        if not self.session.run.wait or not isinstance(stop, (QuotaSpent, Blocked)):
            return False
        return back_at([stop]) is not None and bool(self.left(kind))

    # -- what became of it -------------------------------------------------------------------------

    def _answer(self, phase: Phase, items: list[Item]) -> None:
        """Fetch and record items; an error by its consequence."""
        keys = [item.key for item in items]
        try:
            whole = self._fetch(phase, items)
            self._count(phase, len(items), failed=None, whole=whole)
        except ItemFinal as fact:
            self.frontier.mark(phase.kind, self._unanswered(phase, keys), "skipped", fact.reason)
            self._count(phase, len(items), failed=None)
        except Retryable as error:
            self.frontier.mark(phase.kind, self._unanswered(phase, keys), "error", error.reason)
            self._count(phase, len(items), failed=error.reason)
        except BaseException as error:  # noqa: BLE001  kept as the reason to end
            self.frontier.release(phase.kind, *self._unanswered(phase, keys))
            self._stop(phase, error, len(items))
        finally:
            with self._changed:
                self._in_hand[phase.kind] -= 1
                self._changed.notify_all()

    def _fetch(self, phase: Phase, items: list[Item]) -> bool:
        """Record all answers; whether they are whole. Raises what `fetch` raises."""
        failed: str | None = None
        whole = True
        for answer in self.source.fetch(phase, items):
            self.session.record(answer)
            failed = answer.failed or failed
            whole = whole and answer.whole
        silent = self._unanswered(phase, [item.key for item in items])
        if silent:
            self.frontier.mark(phase.kind, silent, "error", "unanswered")
        if failed is not None:
            raise Retryable(failed)
        return whole

    def _unanswered(self, phase: Phase, keys: list[str]) -> list[str]:
        states = ((key, self.frontier.get(phase.kind, key)) for key in keys)
        return [key for key, state in states if state is not None and state[0] == "in_progress"]

    def _count(self, phase: Phase, n: int, *, failed: str | None, whole: bool = True) -> None:
        """`n` items were answered or failed. A service that fails again and again is down."""
        with self._changed:
            self.answered[phase.kind] += n
            self._failures[phase.lane] = 0 if failed is None else self._failures[phase.lane] + 1
            down = self._failures[phase.lane]
        if failed is None and whole:
            self.session.let_in(phase.lane)
        self._show(phase, n)
        if failed is not None and down >= phase.down:
            self._stop(phase, _down(failed, down), 0)

    def _stop(self, phase: Phase, error: BaseException, given_back: int) -> None:
        """Close what a stop concerns; anything else ends the run."""
        with self._changed:
            if phase.limited:
                self._limit.take(-given_back)
        if not isinstance(error, Stopped) or isinstance(error, _EVERYTHING):
            self._end_all(error)
            return
        if isinstance(error, Blocked):
            self.session.turned_away(phase.lane)
        if isinstance(error, (Blocked, Unreachable)):
            self.session.ended(phase.lane, error)
        with self._changed:
            self._close(phase, error)
            self._changed.notify_all()

    def _end_all(self, error: BaseException) -> None:
        """The run ends: threads finish what they have in hand, or stop waiting for it."""
        for lane in set(self._lanes.values()):
            self.session.ended(lane, error)
        with self._changed:
            self._end = self._end or error
            self._changed.notify_all()

    def _close(self, phase: Phase, stop: Stopped) -> None:
        for kind in together(self.phases, phase, stop):
            self._closed.setdefault(kind, stop)

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

    # -- waiting -----------------------------------------------------------------------------------

    def _back(self, lane: str) -> Any:
        """With --wait: when a lane that was stopped may go on; None when it may not."""
        if not self.session.run.wait:
            return None
        kinds = [phase.kind for phase in self.phases if phase.lane == lane]
        stops = [self._closed[kind] for kind in kinds if kind in self._closed and self.left(kind)]
        return back_at(stop for stop in stops if not isinstance(stop, LimitReached))

    def _sleep(self, lane: str, back: Any) -> None:
        """Wait until the service answers again, then open what its stop had closed."""
        kinds = [phase.kind for phase in self.phases if phase.lane == lane]
        why = next((self._closed[kind] for kind in kinds if kind in self._closed), None)
        said = f"{self.source.name}: waiting until {clock.stamp(back)}"
        if isinstance(why, Blocked) and why.after is not None:
            said = f"waiting {why.after:.0f} s: {why}"
        self.session.run.progress.say(said)
        clock.sleep_until(back)
        self.session.goes_on(lane)
        with self._changed:
            for phase in self.phases:
                stop = self._closed.get(phase.kind)
                if phase.lane == lane and isinstance(stop, (QuotaSpent, Blocked)):
                    del self._closed[phase.kind]


def _down(reason: str, times: int) -> Unreachable:
    return Unreachable(
        f"{reason}; {times} requests failed one after the other",
        hint="the service seems to be down; the same command goes on",
    )
