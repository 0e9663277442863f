"""An open data root of one source: lock, identity, frontier, recorder, tombstones, in this order.

Crawl, refresh, reconstruct, import and purge all begin here, so that each of them waits for the
same lock, refuses the same foreign roots and has taken in the same raw tail.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from kb.artifacts import domain_binding
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import Blocked, Retryable
from kb.crawl.source import Answer, Source
from kb.store import lock
from kb.store.layout import Layout
from kb.store.rawlog.rawlog import Envelope
from kb.store.rawlog.recorder import Recorder
from kb.store.state import identity, tombstones
from kb.store.state.frontier import Frontier

BLOCKED = "blocked:"  # cursor: since when the service turns a lane away
_STEP_S = 0.5  # how soon a thread that waits hears that its lane has ended


@dataclass
class CrawlSession:
    """What the phases of one run share. Thread-safe.

    `place` is where raw answers and state are: the data root, or a work folder. `gone` are the
    keys that were purged.
    """

    run: Run
    source: Source
    frontier: Frontier
    gone: set[str]
    recorder: Recorder = field(init=False)
    _spent: tuple[int, int] = (0, 0)
    _probing: set[str] = field(default_factory=set)
    _ended: dict[str, BaseException] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def record(self, answer: Answer) -> Envelope:
        """Keep an answer and its effect. Raises DiskFull and Retryable, with nothing half-kept."""
        try:
            return self.recorder.record(
                answer.kind, answer.endpoint, answer.params, answer.status, answer.response
            )
        except RecursionError:
            why = f"an answer nested too deeply to be stored at {answer.endpoint}"
            raise Retryable(why) from None

    def requests(self) -> tuple[int, int]:
        """(requests, units) of this run."""
        requests, units = self.frontier.requests()
        return requests - self._spent[0], units - self._spent[1]

    # -- what ends a lane --------------------------------------------------------------------------

    def ended(self, lane: str, why: BaseException) -> None:
        """Nothing more is asked of a lane; threads that wait between two tries hear of it."""
        with self._lock:
            self._ended.setdefault(lane, why)

    def goes_on(self, lane: str) -> None:
        """The wait that a stop asked for is over."""
        with self._lock:
            self._ended.pop(lane, None)

    def check(self, lane: str) -> None:
        """Before a request. Raises Blocked when another thread met it."""
        why = self._ended.get(lane)
        if isinstance(why, Blocked):
            raise why

    def sleep(self, lane: str, seconds: float) -> None:
        """Between two tries. Raises what has ended the lane meanwhile, and Interrupted."""
        while seconds > 0:
            why = self._ended.get(lane)
            if why is not None:
                raise why
            clock.sleep(min(seconds, _STEP_S))
            seconds -= _STEP_S

    # -- after a block -----------------------------------------------------------------------------

    def probing(self, lane: str) -> bool:
        """Whether one request alone is to find out if the service still turns this lane away.

        Never with --wait, which waits as long as the service asks.
        """
        with self._lock:
            return lane in self._probing and not self.run.wait

    def turned_away(self, lane: str) -> None:
        """The service blocks a lane: the next run begins with one request."""
        self.frontier.set_cursor(BLOCKED + lane, clock.stamp())

    def let_in(self, lane: str) -> None:
        """The service answered: nothing needs to be found out any more."""
        with self._lock:
            if lane not in self._probing:
                return
            self._probing.discard(lane)
        self.frontier.set_cursor(BLOCKED + lane, None)

    def look_up_blocks(self, lanes: set[str]) -> None:
        """Which lanes the service turned away when they were last asked."""
        held = {lane for lane in lanes if self.frontier.cursor(BLOCKED + lane) is not None}
        with self._lock:
            self._probing = held


@contextmanager
def open_session(
    run: Run,
    source: Source,
    place: Path | None = None,
    *,
    asks: bool = True,
    tells: bool = True,
) -> Iterator[CrawlSession]:
    """Open a source's part of a data root for writing.

    `place` is a work folder that holds raw answers and state instead of the data root. `asks` is
    false where nothing is asked of the service, so that no credential is needed and any host will
    do. Without `tells` the caller reports by `damaged_answers.report` which raw data are damaged.
    Raises UsageError before anything is sent or written, WriterLocked, DamagedData.
    """
    root = place or run.root
    facts = source.identity() if asks else {}
    with ExitStack() as stack:
        stack.enter_context(lock.writer(root, source.name))
        if root == run.root:
            domain_binding.note(run.root, run.profile)
        identity.remember(root, source.name, **facts)
        frontier = Frontier(Layout(root).state(source.name), payloads=source.payloads)
        stack.callback(frontier.close)
        session = CrawlSession(
            run=run,
            source=source,
            frontier=frontier,
            gone=tombstones.keys(run.root, source.name),
            _spent=frontier.requests(),
        )
        source.begin(session)
        stack.callback(source.close)
        session.look_up_blocks({phase.lane for phase in source.phases})
        asked = [phase.kind for phase in source.phases]
        session.recorder = stack.enter_context(
            Recorder(
                root, source.name, frontier, source.reduce, source.replay, asked=asked, tells=tells
            )
        )
        yield session
