"""An open data root of one source: lock, identity, frontier, recorder, tombstones, in this order.

Crawl, refresh, restore, import and purge all begin here, so that each waits for the same lock,
rejects a data root of another profile and has replayed the same raw tail.
"""

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from kb.artifacts import domain_binding
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import TURNED_AWAY, DamagedData, Retryable, WriterLocked
from kb.crawl.connector import Answer, Connector, Opened
from kb.store import lock
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope
from kb.store.rawlog.recorder import Recorder
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier
from kb.store.tables import reading

BLOCKED = "blocked:"  # cursor: when the service blocked us
_STEP_S = 0.5  # how soon a waiting thread notices that the work on its service has ended


@dataclass(kw_only=True)
class CrawlSession(Opened):
    """What the phases of one run share. Thread-safe."""

    connector: Connector
    recorder: Recorder = field(init=False)
    _probing: set[str] = field(default_factory=set)
    _ended: dict[str, BaseException] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def record(self, answer: Answer) -> Envelope:
        """Record an answer and reduce it, or neither. Raises DiskFull and Retryable."""
        try:
            return self.recorder.record(
                answer.kind, answer.endpoint, answer.params, answer.status, answer.response
            )
        except RecursionError:
            why = f"an answer nested too deeply to be stored at {answer.endpoint}"
            raise Retryable(why) from None

    # -- ending the work of a service --------------------------------------------------------------

    def ended(self, service: str, why: BaseException) -> None:
        """End the work on a service; threads that wait between two attempts raise `why`."""
        with self._lock:
            self._ended.setdefault(service, why)

    def resume(self, service: str) -> None:
        """Resume a service after the wait that a stop asked for."""
        with self._lock:
            self._ended.pop(service, None)

    def refuse_blocked(self, service: str) -> None:
        """Call before a request. Raises Blocked or Challenged when another thread met it."""
        why = self._ended.get(service)
        if isinstance(why, TURNED_AWAY):
            raise why

    def sleep(self, service: str, seconds: float) -> None:
        """Wait between two attempts. Raises what ended the service meanwhile, and Interrupted."""
        while seconds > 0:
            why = self._ended.get(service)
            if why is not None:
                raise why
            clock.sleep(min(seconds, _STEP_S))
            seconds -= _STEP_S

    # -- after a block -----------------------------------------------------------------------------

    def probing(self, service: str) -> bool:
        """Whether to send a single request, to find out if the service still blocks us.

        Never with --wait, which waits as long as the service asks.
        """
        with self._lock:
            return service in self._probing and not self.run.wait

    def record_block(self, service: str) -> None:
        """Remember that a service blocked us: the next run begins with a single request."""
        self.frontier.set_cursor(BLOCKED + service, clock.stamp())

    def clear_block(self, service: str) -> None:
        """The service answered: the block is over."""
        with self._lock:
            if service not in self._probing:
                return
            self._probing.discard(service)
        self.frontier.set_cursor(BLOCKED + service, None)

    def look_up_blocks(self, services: set[str]) -> None:
        """Load which services blocked us in an earlier run."""
        blocked = {
            service for service in services if self.frontier.cursor(BLOCKED + service) is not None
        }
        with self._lock:
            self._probing = blocked


@contextmanager
def open_session(
    run: Run,
    connector: Connector,
    place: Path | None = None,
    *,
    online: bool = True,
    report_damage: bool = True,
    removed: Collection[str] = (),
) -> Iterator[CrawlSession]:
    """Open a source's part of a data root for writing.

    `place` is a work folder that holds raw answers and state instead of the data root. `online` is
    false where nothing is asked of the service, so that no credential is needed and any host will
    do. Without `report_damage` the caller raises `recorder.damage`, which says what raw data have
    lost. `removed` keys count as purged. Raises UsageError before anything is sent or written,
    WriterLocked, DamagedData.
    """
    root = place or run.root
    facts = connector.identity() if online else {}
    with ExitStack() as stack:
        stack.enter_context(lock.writer(root, connector.name))
        if root == run.root:
            domain_binding.note(run.root, run.profile)
        domain_binding.bind_service(root, connector.name, **facts)
        if is_state_missing(root, connector.name):
            run.progress.say(
                f"{connector.name}: its state is missing; it is replayed from raw data"
            )
        frontier = Frontier(Layout(root).state(connector.name), payloads=connector.payloads)
        stack.callback(frontier.close)
        session = CrawlSession(
            run=run,
            connector=connector,
            frontier=frontier,
            purged=tombstones.keys(run.root, connector.name).union(removed),
            _spent=frontier.requests(),
        )
        connector.begin(session)
        stack.callback(connector.close)
        session.look_up_blocks({phase.service for phase in connector.phases})
        asked = [phase.kind for phase in connector.phases]
        session.recorder = stack.enter_context(
            Recorder(
                root,
                connector.name,
                frontier,
                connector.reduce,
                asked=asked,
                report_damage=report_damage,
            )
        )
        yield session


def is_state_missing(root: Path, source: str) -> bool:
    """Whether there are raw answers without the state that they give."""
    return not Layout(root).state(source).exists() and rawlog.any_answer(root, source)


def _is_state_behind(root: Path, source: str) -> bool:
    """Whether there are raw answers that a state has not taken in, as after a merge."""
    path = Layout(root).state(source)
    if not path.exists():
        return False
    try:
        with reading.state(path) as frontier:
            known = frontier.offsets()
    except DamagedData:  # whoever needs it says so
        return False
    return any(
        known.get((segment.parent.name, rawlog.base_name(segment)), 0) < segment.stat().st_size
        for segment in rawlog.all_segments(root, source)
    )


def replay_unread_answers(
    run: Run, source: str, make_connector: Callable[[Run], Connector]
) -> None:
    """Replay a source's state from raw answers where it is missing, and take in those that it does
    not have yet, with one line.

    For commands that only need what the state says. Raises WriterLocked and OSError where a missing
    state can't be written, DamagedData.
    """
    is_missing = is_state_missing(run.root, source)
    if not (is_missing or _is_state_behind(run.root, source)):
        return
    try:
        with open_session(run, make_connector(run), online=False):
            if not is_missing:
                run.progress.say(f"{source}: raw answers that its state did not have are taken in")
    except (WriterLocked, OSError):  # the state says how far it is
        if is_missing:
            raise
