"""Whose turn it is: which items a lane takes next, and what keeps it from taking more.

closed    a kind of which nothing more is asked in this run, and why
above     the kinds whose answers lead to a kind, directly or by way of others
halves    parts of batches that failed: each is asked for by itself, so that one item that always
          fails does not keep those that were asked for with it from being read

These, and what failed in an earlier run, are taken once more after everything else.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Sequence
from datetime import datetime

from kb.core.errors import Blocked, LimitReached, QuotaSpent, Stopped, Unreachable
from kb.crawl.limits import Limit, back_at, together, upstream
from kb.crawl.session import CrawlSession
from kb.crawl.source import Phase
from kb.store.state.frontier import Item

Turn = tuple[Phase, list[Item]]


class Turns:
    """What is in hand, closed and left to take of a run's phases.

    Not thread-safe by itself: the loop asks under its lock.
    """

    def __init__(self, session: CrawlSession, phases: Sequence[Phase]) -> None:
        self.phases = list(phases)
        self._session, self._source, self._frontier = session, session.source, session.frontier
        self._limit = Limit(session.run.limit)
        self._in_hand: Counter[str] = Counter()  # fetches by kind
        self._closed: dict[str, Stopped] = {}
        self._halves: defaultdict[str, deque[tuple[list[Item], str]]] = defaultdict(deque)
        self._ends: dict[str, int] = {}
        self._lanes = {phase.kind: phase.lane for phase in self.phases}
        self._above = {
            phase.kind: upstream(self.phases, phase.kind) & self._lanes.keys()
            for phase in self.phases
        }

    def lanes(self) -> list[str]:
        """In the order of their first phases."""
        return list(dict.fromkeys(self._lanes.values()))

    def begin(self) -> None:
        """The run begins: what failed by now is asked for once more, what fails from now on is
        not, as it goes behind the end of its queue.
        """
        self._ends = {phase.kind: self._frontier.last(phase.kind) for phase in self.phases}

    def end(self) -> None:
        """The run is over: what was in progress is to do again."""
        for kind, halves in self._halves.items():
            self._frontier.release(kind, *(item.key for half, _ in halves for item in half))
        self._halves.clear()

    # -- taking ------------------------------------------------------------------------------------

    def take(self, lane: str) -> Turn | None:
        """The next items of a lane; they are in hand until `done`. None when there are none now."""
        of_lane = self._of(lane)
        if self._session.probing(lane) and any(self._in_hand[phase.kind] for phase in of_lane):
            return None
        self._close_what_is_limited()
        for failed in (False, True):
            for phase in of_lane:
                turn = self._take_of(phase, failed) if self._open(phase, failed) else None
                if turn is not None:
                    return turn
        return None

    def split(self, phase: Phase, items: list[Item], reason: str) -> None:
        """A batch failed: its halves are asked for later; they stay in progress until then."""
        middle = (len(items) + 1) // 2
        self._halves[phase.kind] += (items[:middle], reason), (items[middle:], reason)

    def answered(self, lane: str, phase: Phase | None = None) -> tuple[Phase, Item] | None:
        """An item of a lane, or of one `phase`, that the service has answered; None without one."""
        for each in self._of(lane) if phase is None else [phase]:
            item = self._frontier.answered(each.kind)
            if item is not None and self._source.leave_out(each, item) is None:
                return each, item
        return None

    def another(self, phase: Phase) -> list[Item]:
        """One item that did not fail before, from the far end of the queue; none when there is
        none. It belongs to the turn in hand.
        """
        while phase.kind not in self._closed and (not phase.limited or self._limit.room(1) > 0):
            items = self._frontier.take(phase.kind, newest=True)
            if not items:
                break
            if items := self._wanted(phase, items):
                self._limit.take(int(phase.limited))
                return items
        halves = self._halves[phase.kind]
        if not halves:
            return []
        (*others, last), reason = halves.pop()
        if others:
            halves.append((others, reason))
        return [last]

    def may_come(self, lane: str) -> bool:
        """Whether a thread of this lane should wait for what is in hand, here or above."""
        for phase in self._of(lane):
            if phase.kind in self._closed:
                continue
            above = self._above[phase.kind]
            if self._in_hand[phase.kind] or any(map(self._busy, above)):
                return True
            elsewhere = [kind for kind in above if self._lanes[kind] != lane]
            if any(self._sleeps(kind) or self._retries(kind) for kind in elsewhere):
                return True
        return False

    def give_back(self, phase: Phase, n: int) -> None:
        """`n` items that were taken were not asked for: others may be, below the limit."""
        if phase.limited:
            self._limit.take(-n)

    def done(self, phase: Phase) -> None:
        """What was taken in one turn is in hand no more."""
        self._in_hand[phase.kind] -= 1

    def _of(self, lane: str) -> list[Phase]:
        return [phase for phase in self.phases if phase.lane == lane]

    def _close_what_is_limited(self) -> None:
        """As many were answered as the limit allows: nothing more is listed for them either."""
        for phase in self.phases:
            kind = phase.kind
            if not phase.limited or phase.seeks or self._in_hand[kind] or self._halves[kind]:
                continue
            if self._limit.room(1) <= 0:
                self.close(phase, self._limit.reached())

    def _open(self, phase: Phase, failed: bool) -> bool:
        """Whether a phase may be worked on now, as far as the others are concerned."""
        if phase.kind in self._closed or self._in_hand[phase.kind] >= phase.workers:
            return False
        waits = phase.whole or failed
        return not (waits and any(self._busy(kind) for kind in self._above[phase.kind]))

    def _take_of(self, phase: Phase, failed: bool) -> Turn | None:
        """Items of a phase, without those that the source leaves out."""
        while failed and self._halves[phase.kind]:
            half, reason = self._halves[phase.kind].popleft()
            if self.answered(phase.lane, phase) is not None:
                self._in_hand[phase.kind] += 1
                return phase, half
            # Nothing of this kind was ever answered: it is not one item that spoils the batch.
            self._frontier.mark(phase.kind, (item.key for item in half), "error", reason)
        ready, take = self._frontier.ready, self._frontier.take
        upto = self._ends[phase.kind] if failed else None
        while ready(phase.kind, failed_upto=upto):
            room = self._limit.room(phase.batch) if phase.limited else phase.batch
            if phase.packed and ready(phase.kind, room) < room and self._more(phase):
                return None
            # What is left out takes nothing of the limit, so it is looked for beyond it too.
            items = self._wanted(phase, take(phase.kind, max(room, 1), failed_upto=upto))
            if not items:
                continue
            if room <= 0:
                self._frontier.release(phase.kind, *(item.key for item in items))
                self.close(phase, self._limit.reached())
                return None
            chosen = self._source.pack(phase, items)
            keys = {item.key for item in chosen}
            others = (item.key for item in items if item.key not in keys)
            self._frontier.release(phase.kind, *others)
            self._in_hand[phase.kind] += 1
            if phase.limited:
                self._limit.take(len(chosen))
            return phase, chosen
        return None

    def _wanted(self, phase: Phase, items: list[Item]) -> list[Item]:
        wanted = []
        for item in items:
            reason = self._source.leave_out(phase, item)
            if reason is None:
                wanted.append(item)
            else:
                self._frontier.skip(phase.kind, item.key, reason)
        return wanted

    def _busy(self, kind: str) -> bool:
        """Whether a phase has items in hand, or some that this run will take."""
        if self._in_hand[kind]:
            return True
        return kind not in self._closed and bool(self._halves[kind] or self._frontier.ready(kind))

    def _retries(self, kind: str) -> bool:
        """Whether what failed in a phase will be asked for once more in this run."""
        upto = self._ends[kind]
        return kind not in self._closed and bool(self._frontier.ready(kind, failed_upto=upto))

    def _more(self, phase: Phase) -> bool:
        """Whether the phase's own lane can be asked for more of its items first."""
        own = {one.kind for one in self._of(phase.lane)}
        return any(self._busy(kind) for kind in self._above[phase.kind] & own)

    def _sleeps(self, kind: str) -> bool:
        """Whether a phase was stopped and its lane waits until it may go on."""
        stop = self._closed.get(kind)
        if not self._session.run.wait or not isinstance(stop, (QuotaSpent, Blocked)):
            return False
        return back_at([stop]) is not None and bool(self._frontier.waiting(kind))

    # -- what keeps it -----------------------------------------------------------------------------

    def close(self, phase: Phase, stop: Stopped) -> None:
        """Nothing more is asked of what a stop concerns; an earlier reason stays."""
        for kind in together(self.phases, phase, stop):
            self._closed.setdefault(kind, stop)

    def reopen(self, lane: str) -> None:
        """A wait is over: what a spent quota or a block had closed goes on."""
        for phase in self._of(lane):
            if isinstance(self._closed.get(phase.kind), (QuotaSpent, Blocked)):
                del self._closed[phase.kind]

    def stops(self) -> list[Stopped]:
        """Why something is left. A limit that took all there was is no reason.

        Of a service that is down nothing may wait any more: the last items have failed.
        """
        return [
            stop
            for kind, stop in self._closed.items()
            if self._frontier.waiting(kind) or isinstance(stop, Unreachable)
        ]

    def why(self, lane: str) -> Stopped | None:
        """What has stopped a lane first."""
        closed = (self._closed.get(phase.kind) for phase in self._of(lane))
        return next(filter(None, closed), None)

    def back(self, lane: str) -> datetime | None:
        """With --wait: when a lane that was stopped may go on; None when it may not."""
        if not self._session.run.wait:
            return None
        stops = [
            stop
            for kind, stop in self._closed.items()
            if self._lanes[kind] == lane and self._frontier.waiting(kind)
        ]
        return back_at(stop for stop in stops if not isinstance(stop, LimitReached))
