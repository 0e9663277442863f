"""Chooses the items that the threads of a service work on next, and closes what must not go on.

closed    kinds that this run requests no more, and why
above     the kinds whose answers lead to a kind, directly or indirectly
halves    halves of failed batches: each is requested by itself, so that one item that always
          fails does not block the others of its batch
in hand   how many requests of a kind are on their way

A service's phases are tried in their order, twice: first for new items, then for halves and for
items that failed in an earlier run, which are retried once.
"""

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Sequence
from datetime import datetime

from kb.core.errors import Blocked, LimitReached, QuotaSpent, Stopped, Unreachable
from kb.crawl.connector import Phase
from kb.crawl.limits import Limit, back_at, together, upstream
from kb.crawl.session import CrawlSession
from kb.store.state.frontier import Item

Turn = tuple[Phase, list[Item]]


class Scheduler:
    """The items in progress, closed and left of a run's phases.

    Not thread-safe by itself: the loop asks under its lock. `give_up` is told of items that failed
    with their batch and are not asked for by themselves, and why.
    """

    def __init__(
        self,
        session: CrawlSession,
        phases: Sequence[Phase],
        give_up: Callable[[str, list[Item], str], None] = lambda kind, items, reason: None,
    ) -> None:
        self._give_up = give_up
        self.phases = list(phases)
        self._session, self._connector = session, session.connector
        self._frontier = session.frontier
        self._limit = Limit(session.run.limit)
        self._in_hand: Counter[str] = Counter()  # fetches by kind
        self._closed: dict[str, Stopped] = {}
        self._halves: defaultdict[str, deque[tuple[list[Item], str]]] = defaultdict(deque)
        self._ends: dict[str, int] = {}
        self._left_out = 0
        self._services = {phase.kind: phase.service for phase in self.phases}
        self._above = {
            phase.kind: upstream(self.phases, phase.kind) & self._services.keys()
            for phase in self.phases
        }

    def services(self) -> list[str]:
        """In the order of their first phases."""
        return list(dict.fromkeys(self._services.values()))

    def begin(self) -> None:
        """Begin the run: what failed before is retried once; what fails from now on is not, as it
        goes behind the end of its queue.
        """
        self._ends = {phase.kind: self._frontier.last(phase.kind) for phase in self.phases}

    def end(self) -> None:
        """End the run: what was in progress goes back to the queue."""
        for kind, halves in self._halves.items():
            self._frontier.release(kind, *(item.key for half, _ in halves for item in half))
        self._halves.clear()

    # -- taking ------------------------------------------------------------------------------------

    def take(self, service: str) -> Turn | None:
        """The next items of a service, in progress until `done`; None when there are none now."""
        of_service = self._of(service)
        if self._session.probing(service) and any(
            self._in_hand[phase.kind] for phase in of_service
        ):
            return None
        self._close_what_is_limited()
        left_out = self._left_out
        for failed in (False, True):
            for phase in of_service:
                if not self._may_run(phase, failed):
                    continue
                turn = self._half(phase) if failed else None
                turn = turn or self._queued(phase, failed)
                if turn is not None:
                    return turn
        # A phase may have waited for items that were then left out.
        return self.take(service) if self._left_out > left_out else None

    def split(self, phase: Phase, items: list[Item], reason: str) -> None:
        """Split a failed batch: its halves are requested later and stay in progress until then."""
        middle = (len(items) + 1) // 2
        self._halves[phase.kind] += (items[:middle], reason), (items[middle:], reason)

    def answered(self, service: str, phase: Phase | None = None) -> tuple[Phase, Item] | None:
        """An item that the service has answered, of one `phase` if given; None without one."""
        for asked in self._of(service) if phase is None else [phase]:
            item = self._frontier.answered(asked.kind)
            if item is not None and self._connector.leave_out(asked, item) is None:
                return asked, item
        return None

    def another(self, phase: Phase) -> list[Item]:
        """One item that has not failed before, from the far end of the queue, if there is one. It
        belongs to the current turn.
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

    def has_upstream_work(self, service: str) -> bool:
        """Whether a thread of this service should wait for items in progress, here or above."""
        for phase in self._of(service):
            if phase.kind in self._closed:
                continue
            above = self._above[phase.kind]
            if self._in_hand[phase.kind] or any(map(self._has_work, above)):
                return True
            elsewhere = [kind for kind in above if self._services[kind] != service]
            if any(self._will_resume(kind) or self._will_retry(kind) for kind in elsewhere):
                return True
        return False

    def give_back(self, phase: Phase, n: int) -> None:
        """Return `n` items that were taken but not requested to the limit."""
        if phase.limited:
            self._limit.take(-n)

    def done(self, phase: Phase) -> None:
        """One turn is finished."""
        self._in_hand[phase.kind] -= 1

    def _of(self, service: str) -> list[Phase]:
        return [phase for phase in self.phases if phase.service == service]

    def _close_what_is_limited(self) -> None:
        """Close the phases whose limit is reached, and those that feed them."""
        for phase in self.phases:
            kind = phase.kind
            if not phase.limited or phase.seeks or self._in_hand[kind] or self._halves[kind]:
                continue
            if self._limit.room(1) <= 0:
                self.close(phase, self._limit.reached())

    def _may_run(self, phase: Phase, failed: bool) -> bool:
        """Whether the other phases allow this one to run now."""
        if phase.kind in self._closed or self._in_hand[phase.kind] >= phase.workers:
            return False
        must_wait = phase.waits or failed
        return not (must_wait and any(self._has_work(kind) for kind in self._above[phase.kind]))

    def _half(self, phase: Phase) -> Turn | None:
        """Half of a batch that has failed, where a single item may be the reason."""
        while self._halves[phase.kind]:
            half, reason = self._halves[phase.kind].popleft()
            if self.answered(phase.service, phase) is not None:
                self._in_hand[phase.kind] += 1
                return phase, half
            # Nothing of this kind was ever answered, so a single item is not the reason.
            self._frontier.mark(phase.kind, (item.key for item in half), "error", reason)
            self._give_up(phase.kind, half, reason)
        return None

    def _queued(self, phase: Phase, failed: bool) -> Turn | None:
        """New items of a phase, or those that failed in an earlier run; as many as fit into a
        request and the limit.
        """
        ready, take = self._frontier.ready, self._frontier.take
        upto = self._ends[phase.kind] if failed else None
        while ready(phase.kind, failed_upto=upto):
            room = self._limit.room(phase.batch) if phase.limited else phase.batch
            if phase.packed and ready(phase.kind, room) < room and self._may_find_more(phase):
                return None
            # What is left out takes nothing of the limit, so it is looked for beyond it too.
            items = self._wanted(phase, take(phase.kind, max(room, 1), failed_upto=upto))
            if not items:
                continue
            if room <= 0:
                self._frontier.release(phase.kind, *(item.key for item in items))
                self.close(phase, self._limit.reached())
                return None
            chosen = self._connector.pack(phase, items)
            keys = {item.key for item in chosen}
            others = (item.key for item in items if item.key not in keys)
            self._frontier.release(phase.kind, *others)
            self._in_hand[phase.kind] += 1
            if phase.limited:
                self._limit.take(len(chosen))
            return phase, chosen
        return None

    def _wanted(self, phase: Phase, items: list[Item]) -> list[Item]:
        """The items without those that the source leaves out, which are marked."""
        wanted = []
        for item in items:
            reason = self._connector.leave_out(phase, item)
            if reason is None:
                wanted.append(item)
            else:
                self._frontier.skip(phase.kind, item.key, reason)
                self._left_out += 1
        return wanted

    def _has_work(self, kind: str) -> bool:
        """Whether a phase has items in progress or items that this run will take."""
        if self._in_hand[kind]:
            return True
        return kind not in self._closed and bool(self._halves[kind] or self._frontier.ready(kind))

    def _will_retry(self, kind: str) -> bool:
        """Whether this run will retry failed items of a phase."""
        upto = self._ends[kind]
        return kind not in self._closed and bool(self._frontier.ready(kind, failed_upto=upto))

    def _may_find_more(self, phase: Phase) -> bool:
        """Whether the phase's own service may find more of its items first."""
        own = {other.kind for other in self._of(phase.service)}
        return any(self._has_work(kind) for kind in self._above[phase.kind] & own)

    def _will_resume(self, kind: str) -> bool:
        """Whether a phase was stopped and its service waits to resume."""
        stop = self._closed.get(kind)
        if not self._session.run.wait or not isinstance(stop, (QuotaSpent, Blocked)):
            return False
        return back_at([stop]) is not None and bool(self._frontier.waiting(kind))

    # -- closing and reopening ---------------------------------------------------------------------

    def close(self, phase: Phase, stop: Stopped) -> None:
        """Close the phases that a stop concerns; an earlier reason stays."""
        for kind in together(self.phases, phase, stop):
            self._closed.setdefault(kind, stop)

    def reopen(self, service: str) -> None:
        """Reopen after a wait what a spent quota or a block had closed."""
        for phase in self._of(service):
            if isinstance(self._closed.get(phase.kind), (QuotaSpent, Blocked)):
                del self._closed[phase.kind]

    def stops(self) -> list[Stopped]:
        """Why something is left. A limit that left nothing over does not count.

        A service that is down may have nothing waiting any more: its last items have failed.
        """
        return [
            stop
            for kind, stop in self._closed.items()
            if self._frontier.waiting(kind) or isinstance(stop, Unreachable)
        ]

    def why(self, service: str) -> Stopped | None:
        """The first stop of a service."""
        closed = (self._closed.get(phase.kind) for phase in self._of(service))
        return next(filter(None, closed), None)

    def back(self, service: str) -> datetime | None:
        """With --wait: when a stopped service may resume; None when it may not."""
        if not self._session.run.wait:
            return None
        stops = [
            stop
            for kind, stop in self._closed.items()
            if self._services[kind] == service and self._frontier.waiting(kind)
        ]
        return back_at(stop for stop in stops if not isinstance(stop, LimitReached))
