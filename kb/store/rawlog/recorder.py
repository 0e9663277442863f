"""The order of writing that makes a crawl survive SIGKILL.

    ledger row (committed) → request → one frame, synced → frontier and offset in one transaction

At start the raw tail past the known offset is replayed into the frontier by the same function
that a live answer goes through, so nothing that was answered is asked again. Where raw data are
damaged or missing, all that is left is replayed (kb.store.rawlog.quarantine).
"""

import os
import threading
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, Self

from kb.core import clock
from kb.core.errors import DamagedData
from kb.store.atomic import sync_folder
from kb.store.damage import forget_damage
from kb.store.rawlog import quarantine, rawlog
from kb.store.rawlog.quarantine import Apply, LostRange
from kb.store.rawlog.rawlog import Envelope, Request, Segment
from kb.store.state.frontier import Frontier

_AGAIN = "run the same command again: it moves damaged data away and lists what that contained"


class Recorder:
    """Writes a source's answers. Make it under the source's writer lock; close it at the end.

    `asked`: the kinds of items that a crawl asks for. Raw data that are damaged or missing are set
    aside, the state is replayed from what is left, and what is absent then is to do again:
    `damage` is the error that says so, which is raised unless `report_damage` is false.
    """

    def __init__(
        self,
        root: Path,
        source: str,
        frontier: Frontier,
        apply: Apply,
        *,
        asked: Collection[str] = (),
        report_damage: bool = True,
    ) -> None:
        self._root, self._source, self._frontier, self._apply = root, source, frontier, apply
        self._asked = asked
        self._segments: dict[str, Segment] = {}
        self._lock = threading.Lock()
        self.damage: DamagedData | None = None
        self._set_damage_aside(every=False)
        if self.damage is not None and report_damage:
            raise self.damage

    def check_all_segments(self) -> None:
        """Set aside what can't be read of segments that nothing was wrong with by the state. The
        open segments must be closed.
        """
        self._set_damage_aside(every=True)

    def _set_damage_aside(self, *, every: bool) -> None:
        # Killed on the way, the next run finds what is left to set aside, and replays the rest.
        segments = quarantine.noted_segments(self._root, self._source)
        lost = quarantine.losses(self._root, self._source, self._frontier, every=every)
        if lost:
            with self._frontier.transaction():
                self._frontier.start_over()
                self._frontier.note_lost(quarantine.lost_imports(lost))
            lost = quarantine.set_aside(lost)
        forget_damage(self._root, *segments)
        recover(self._root, self._source)
        lost += self._replay()
        items = [*quarantine.lost_imports(lost), *self._frontier.settle(self._asked)]
        if lost or items:
            self.damage = quarantine.damage_of(self._root, self._source, lost, items)

    def record(
        self,
        kind: str,
        endpoint: str,
        params: dict[str, Any],
        status: int,
        response: Any,
    ) -> Envelope:
        """Keep one answer and its effect on the frontier.

        Raises DiskFull: then the answer is not on disk, or the next run replays it.
        """
        answer = Envelope(clock.stamp(), Request(endpoint, params), status, response)
        [(envelope, _)] = self._keep(kind, [answer])
        return envelope

    def record_all(self, kind: str, answers: Iterable[Envelope]) -> list[bytes]:
        """Keep answers that came together, with times of their own; their lines as they are kept.

        Raises DiskFull, as `record`.
        """
        return [line for _, line in self._keep(kind, answers)]

    def _keep(self, kind: str, answers: Iterable[Envelope]) -> list[tuple[Envelope, bytes]]:
        # The frontier sees what is on disk, as it would from a replay.
        kept = [rawlog.storable(answer) for answer in answers]
        with self._lock:
            if kind not in self._segments:
                self._segments[kind] = Segment(rawlog.folder(self._root, self._source, kind))
            name, offset = self._segments[kind].append(*(line for _, line in kept))
            try:
                with self._frontier.transaction():
                    for envelope, _ in kept:
                        self._apply(self._frontier, kind, envelope)
                    self._frontier.set_offset(kind, name, offset)
            except BaseException:
                # The next run replays these frames: no later offset of this run may cover them.
                self._segments.pop(kind).close()
                raise
        return kept

    def close(self) -> None:
        """Close the open segments."""
        with self._lock:
            for segment in self._segments.values():
                segment.close()
            self._segments.clear()
            self._frontier.forget_fetched()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, *trace: object
    ) -> None:
        if isinstance(error, DamagedData):
            # Met by a reader in a segment that nothing was wrong with by the state.
            quarantine.note(self._root, self._source, error, _AGAIN)
        self.close()

    def _replay(self) -> list[LostRange]:
        """Take in what the frontier has not seen: a tail after a crash, copied segments, or all;
        what was set aside of segments that it did not know.
        """
        lost: list[LostRange] = []
        for path in rawlog.all_segments(self._root, self._source):
            try:
                replay_segment(path, self._frontier, self._apply)
            except DamagedData as error:
                if path not in error.paths:
                    raise
                damaged = quarantine.lost_of(path)
                self._frontier.note_lost(quarantine.lost_imports(damaged))
                lost += quarantine.set_aside(damaged)
                replay_segment(path, self._frontier, self._apply)
        return lost


def replay_segment(path: Path, frontier: Frontier, apply: Apply) -> None:
    """Take in what the frontier has not seen of a segment. Raises DamagedData, with nothing taken
    in, where something can't be read.
    """
    kind, name = path.parent.name, rawlog.base_name(path)
    start = frontier.offset(kind, name)
    if start >= path.stat().st_size:
        return
    frames = rawlog.Frames(path, start, checked=True)
    with frontier.transaction():
        for _, line in frames:
            apply(frontier, kind, rawlog.decode(line))
        frontier.set_offset(kind, name, frames.good)


def recover(root: Path, source: str) -> None:
    """Cut torn frames off the ends of open segments and close them.

    Called under the writer's lock, before anything is written, and after
    `kb.store.rawlog.quarantine` took out committed answers that can't be read: only bytes
    that no state knows are cut.
    """
    for path in rawlog.all_segments(root, source):
        if not path.name.endswith(".open"):
            continue
        frames = rawlog.Frames(path, skip_damage=True)
        for _ in frames:
            pass
        if frames.torn:
            with path.open("r+b") as file:
                file.truncate(frames.good)
                os.fsync(file.fileno())
        if frames.good == 0:
            path.unlink()
        else:
            os.rename(path, path.with_name(path.name.removesuffix(".open")))
        sync_folder(path.parent)
