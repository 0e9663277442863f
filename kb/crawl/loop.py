"""Runs the phases of a source, in parallel per service, until nothing is left or a stop ends it.

    a service  has its own threads; they prefer the phase that is nearest to a complete item
    a stop     (quota spent, blocked, limit) closes the phases it concerns; the others go on
    an error   of another kind, a full disk or a signal ends the run after the current items

The class of an error decides what happens to the current items.
kb.crawl.phase_scheduler chooses them.
"""

import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from kb.core import clock, signals
from kb.core.errors import (
    GLOBAL_STOPS,
    TURNED_AWAY,
    Blocked,
    ItemFinal,
    Postponed,
    Retryable,
    Stopped,
    Unreachable,
    severity,
)
from kb.core.progress import Task
from kb.crawl.connector import Phase
from kb.crawl.phase_scheduler import Scheduler, Turn
from kb.crawl.session import CrawlSession
from kb.store.state.frontier import Item


@dataclass
class Tried:
    """Results of one kind in a run: items requested, those requested for the first time, and the
    failed and the permanently unreadable ones by reason.
    """

    n: int = 0
    first: int = 0
    failed: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)

    @property
    def n_read(self) -> int:
        """How many were read."""
        return self.n - self.failed.total() - self.skipped.total()


class Loop:
    """One run over the frontier. `answered` counts answered and failed items by kind.

    `facts` gives the figures that a phase's progress bar shows beside its count.
    """

    def __init__(
        self,
        session: CrawlSession,
        phases: Sequence[Phase] | None = None,
        *,
        facts: Callable[[Phase], dict[str, object]] | None = None,
    ) -> None:
        self.session, self.frontier, self.connector = session, session.frontier, session.connector
        self.answered: Counter[str] = Counter()
        self.tried: defaultdict[str, Tried] = defaultdict(Tried)  # by kind
        phases = session.connector.phases if phases is None else phases
        self.scheduler = Scheduler(session, phases, self._give_up)
        self._facts = facts or (lambda phase: {})
        self._changed = threading.Condition()
        self._end: BaseException | None = None  # why everything ends
        self._failures: Counter[str] = Counter()  # in a row, by service
        self._up: set[str] = set()  # services that had an answer in this run
        self._doubtful: dict[str, tuple[Phase, Retryable]] = {}  # the last failure of the others
        self._bars: dict[str, Task] = {}

    def run(self) -> None:
        """Work until nothing is left. Raises the reason when items are left that could be read.

        The first service works in the caller's thread, which receives signals.
        """
        self.scheduler.begin()
        services = self.scheduler.services()
        threads = [
            threading.Thread(target=self._work, args=(service,), name=f"{service}-{number}")
            for service in services
            for number in range(
                max(phase.workers for phase in self.scheduler.phases if phase.service == service)
            )
            if (service, number) != (services[0], 0)
        ]
        for thread in threads:
            thread.start()
        try:
            if services:
                self._work(services[0])
        finally:
            for thread in threads:
                thread.join()
            self._check_silent_services()
            self.scheduler.end()
            stopped = self._end is not None or bool(self.scheduler.stops())
            for bar in self._bars.values():
                bar.close(stopped=stopped)
        stops = self.scheduler.stops()
        if isinstance(self._end, Stopped):
            stops.insert(0, self._end)
        elif self._end is not None:
            raise self._end
        if stops:
            raise min(stops, key=severity)

    def _check_silent_services(self) -> None:
        """Stop for a service that is down but had too few items to show it.

        An item that the service answered in an earlier run is requested to find out.
        """
        for phase, failure in self._doubtful.values():
            if self._end is not None or self.scheduler.stops():
                return
            known = self.scheduler.answered(phase.service)
            if known is None or not self._answers(*known):
                self._stop(phase, _down(failure), 0)

    # -- one thread --------------------------------------------------------------------------------

    def _work(self, service: str) -> None:
        """Take turns of a service until none is left."""
        try:
            while True:
                signals.stop.raise_if_asked()
                turn = self._wait_for_turn(service)
                if turn is None:
                    return
                try:
                    self._ask(*turn)
                finally:
                    with self._changed:
                        self.scheduler.done(turn[0])
                        self._changed.notify_all()
        except BaseException as error:  # noqa: BLE001  raised again by the thread that called run
            self._end_all(error)
        finally:
            with self._changed:
                self._changed.notify_all()

    def _wait_for_turn(self, service: str) -> Turn | None:
        """The next items of a service; None when nothing is left in this run."""
        while True:
            with self._changed:
                if self._end is not None:
                    return None
                turn = self.scheduler.take(service)
                if turn is not None:
                    return turn
                if self.scheduler.has_upstream_work(service):
                    self._changed.wait(timeout=0.2)
                    signals.stop.raise_if_asked()
                    continue
                back, why = self.scheduler.back(service), self.scheduler.why(service)
                if back is None:
                    return None
            self._sleep(service, back, why)

    def _sleep(self, service: str, back: datetime, why: Stopped | None) -> None:
        """Wait until the service accepts requests, then reopen what its stop had closed."""
        message = f"{self.connector.name}: waiting until {clock.stamp(back)}"
        if isinstance(why, Blocked) and why.after is not None:
            message = f"waiting {why.after:.0f} s: {why}"
        self.session.run.progress.say(message)
        clock.sleep_until(back)
        self.session.resume(service)
        with self._changed:
            self.scheduler.reopen(service)

    # -- results -----------------------------------------------------------------------------------

    def _ask(self, phase: Phase, items: list[Item]) -> None:
        """Fetch and record items. After failures, stop if the service is down."""
        failure = self._fetch(phase, items)
        if failure is None:
            return
        with self._changed:
            self._failures[phase.service] += 1
            doubtful = failure.unreachable or self._failures[phase.service] >= phase.down
            if doubtful:
                self._failures[phase.service] = 0  # other threads go on meanwhile
        if doubtful and not self._is_up(phase):
            self._stop(phase, _down(failure), 0)

    def _is_up(self, phase: Phase) -> bool:
        """Whether the service answers for an item that has not failed before.

        An item that it has answered is requested again without recording the answer. If there is
        none, another item of the queue is fetched.
        """
        known = self.scheduler.answered(phase.service, phase)
        if known is not None:
            return self._answers(*known)
        with self._changed:
            another = self.scheduler.another(phase)
        return bool(another) and self._fetch(phase, another) is None

    def _answers(self, phase: Phase, item: Item) -> bool:
        try:
            answer = next(iter(self.connector.fetch(phase, [item])), None)
        except (ItemFinal, Postponed):
            return True
        except Retryable:
            return False
        except BaseException as error:  # noqa: BLE001  kept as the reason to end
            self._stop(phase, error, 0)
            return True
        return answer is None or answer.failed is None

    def _fetch(self, phase: Phase, items: list[Item]) -> Retryable | None:
        """Fetch and record items and handle errors by class. Returns the failure, if any."""
        failure: Retryable | None = None
        complete = True
        try:
            for answer in self.connector.fetch(phase, items):
                self.session.record(answer)
                if answer.failed is not None:
                    failure = Retryable(answer.failed)
                complete = complete and answer.complete
        except ItemFinal as fact:
            self.frontier.mark(phase.kind, self._unanswered(phase, items), "skipped", fact.reason)
        except Retryable as error:
            failure = error
        except Postponed:
            self.frontier.release(phase.kind, *self._unanswered(phase, items), last=True)
            with self._changed:
                self.scheduler.give_back(phase, len(items))
            return None
        except BaseException as error:  # noqa: BLE001  kept as the reason to end
            # Another item tests whether a block is over, as one item may be refused forever.
            refused = isinstance(error, TURNED_AWAY)
            self.frontier.release(phase.kind, *self._unanswered(phase, items), last=refused)
            self._stop(phase, error, len(items))
            return None
        self._settle(phase, items, failure, complete)
        return failure

    def _settle(
        self, phase: Phase, items: list[Item], failure: Retryable | None, complete: bool
    ) -> None:
        """Decide about items without an answer, count the others, and note whether the service is
        up.
        """
        left = self._unanswered(phase, items)
        if failure is not None and len(left) > 1:  # one of them may be the reason
            with self._changed:
                retried = [item for item in items if item.key in left]
                self.scheduler.split(phase, retried, failure.reason)
                self._changed.notify_all()
            items = [item for item in items if item.key not in left]
        elif left:
            reason = "unanswered" if failure is None else failure.reason
            self.frontier.mark(phase.kind, left, "error", reason)
        self._count(phase, items)
        with self._changed:
            if failure is None:
                self._failures[phase.service] = 0
                self._doubtful.pop(phase.service, None)
                self._up.add(phase.service)
            elif phase.service not in self._up:
                self._doubtful[phase.service] = phase, failure
        if failure is None and complete:
            self.session.clear_block(phase.service)
        self._show(phase, len(items))

    def _count(self, phase: Phase, items: list[Item]) -> None:
        """Count items that were requested, by what the frontier says of them now."""
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

    def _give_up(self, kind: str, items: list[Item], reason: str) -> None:
        """Count items that failed with their batch."""
        tried = self.tried[kind]
        tried.n += len(items)
        tried.first += sum(not item.failed for item in items)
        tried.failed[reason] += len(items)

    def _unanswered(self, phase: Phase, items: list[Item]) -> list[str]:
        states = ((item.key, self.frontier.get(phase.kind, item.key)) for item in items)
        return [key for key, state in states if state is not None and state[0] == "in_progress"]

    def _stop(self, phase: Phase, error: BaseException, given_back: int) -> None:
        """Close the phases that a stop concerns; any other error ends the run."""
        with self._changed:
            self.scheduler.give_back(phase, given_back)
        if not isinstance(error, Stopped) or isinstance(error, GLOBAL_STOPS):
            self._end_all(error)
            return
        if isinstance(error, Blocked) and error.after is not None and error.until is None:
            error.until = clock.now() + timedelta(seconds=error.after)
        if isinstance(error, TURNED_AWAY):
            self.session.record_block(phase.service)
        if isinstance(error, (*TURNED_AWAY, Unreachable)):
            self.session.ended(phase.service, error)
        with self._changed:
            self.scheduler.close(phase, error)
            self._changed.notify_all()

    def _end_all(self, error: BaseException) -> None:
        """End the run: threads finish their current items or stop waiting."""
        for service in self.scheduler.services():
            self.session.ended(service, error)
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
