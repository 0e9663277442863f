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

from kb.core import clock
from kb.core.context import Run
from kb.crawl.source import Answer, Source
from kb.store import identity, lock, tombstones
from kb.store.frontier import Frontier
from kb.store.layout import Layout
from kb.store.rawlog import Envelope
from kb.store.recorder import Recorder

_BLOCKED = "blocked:"  # cursor: since when the service turns a lane away


@dataclass
class Session:
    """What the phases of one run share. Thread-safe.

    `place` is where raw answers and state are: the data root, or a work folder. `gone` are the
    keys that were purged.
    """

    run: Run
    source: Source
    place: Path
    frontier: Frontier
    recorder: Recorder
    gone: set[str]
    _spent: tuple[int, int] = (0, 0)
    _probing: set[str] = field(default_factory=set)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def record(self, answer: Answer) -> Envelope:
        """Keep an answer and its effect. Raises DiskFull, with nothing half-kept."""
        return self.recorder.record(
            answer.kind, answer.endpoint, answer.params, answer.status, answer.response
        )

    def requests(self) -> tuple[int, int]:
        """(requests, units) of this run."""
        requests, units = self.frontier.requests()
        return requests - self._spent[0], units - self._spent[1]

    # -- after a block -----------------------------------------------------------------------------

    def probing(self, lane: str) -> bool:
        """Whether one request alone is to find out if the service still turns this lane away."""
        with self._lock:
            return lane in self._probing

    def turned_away(self, lane: str) -> None:
        """The service blocks a lane: the next run begins with one request."""
        self.frontier.set_cursor(_BLOCKED + lane, clock.stamp())

    def let_in(self, lane: str) -> None:
        """The service answered: nothing needs to be found out any more."""
        with self._lock:
            if lane not in self._probing:
                return
            self._probing.discard(lane)
        self.frontier.set_cursor(_BLOCKED + lane, None)


@contextmanager
def open_session(run: Run, source: Source, place: Path | None = None) -> Iterator[Session]:
    """Open a source's part of a data root for writing.

    Raises UsageError before anything is sent or written, WriterLocked, DamagedData.
    """
    root = place or run.root
    facts = source.identity()
    with ExitStack() as stack:
        stack.enter_context(lock.writer(root, source.name))
        identity.remember(root, source.name, **facts)
        frontier = Frontier(Layout(root).state(source.name), payloads=source.payloads)
        stack.callback(frontier.close)
        gone = tombstones.keys(run.root, source.name)
        recorder = stack.enter_context(Recorder(root, source.name, frontier, source.reduce))
        stack.callback(source.close)
        lanes = {phase.lane for phase in source.phases}
        yield Session(
            run=run,
            source=source,
            place=root,
            frontier=frontier,
            recorder=recorder,
            gone=gone,
            _spent=frontier.requests(),
            _probing={lane for lane in lanes if frontier.cursor(_BLOCKED + lane) is not None},
        )
