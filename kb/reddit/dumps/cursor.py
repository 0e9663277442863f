"""How far each dump was imported: a note a dump and span of time, in state/reddit-import/.

A segment is written as a hidden part, named, noted, then renamed. A note whose segment did not get
to its place is completed at the next start; parts that no note knows go, as what they hold is read
again.
"""

from __future__ import annotations

import hashlib
import os
import threading
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec

from kb.core import signals
from kb.store import notes, rawlog
from kb.store.atomic import sync_folder, write_bytes
from kb.store.layout import Layout
from kb.store.rawlog import SUFFIX

KIND = "dumps"
PART = ".part"
_LEASE = ".lease"
_START = 1 << 16  # bytes of a dump that are compared at its beginning
_BLOCKS, _BLOCK = 1024, 4096  # and behind it, as far from each other as its size asks for
_MEND = "delete it; the dump is read once more, and what is here already counts once"


class DumpCursor(msgspec.Struct):
    """How far a dump was imported. `offset` in decompressed bytes; `segment` the last one noted."""

    file: str
    offset: int = 0
    segments: int = 0
    segment: str = ""
    things: int = 0
    lines: int = 0
    bad_lines: int = 0
    truncated: bool = False
    problem: str = ""
    done: bool = False
    fresh: int = 0  # things of this run
    first_bad: int | None = None  # offset of the first damaged line
    round: str = ""  # of --again
    changed: int = 0  # when the dump was written (ns), as it was read to its end

    @property
    def damaged(self) -> bool:
        """Whether the dump was cut off or had lines that could not be read."""
        return self.truncated or self.bad_lines > 0


def name_of(file: Path, since: float, until: float) -> str:
    """The name of a dump's note: tells a dump by its name, size and what stands all over it,
    wherever it lies, and the span of time.
    """
    size = file.stat().st_size
    whole = hashlib.sha256(f"{file.name}\0{size}\0".encode())
    with file.open("rb") as opened:
        whole.update(opened.read(_START))
        step = max(_BLOCK, (size - _START - _BLOCK) // (_BLOCKS - 1))
        for at in (*range(_START, size - _BLOCK, step), max(size - _BLOCK, _START)):
            opened.seek(at)
            whole.update(opened.read(_BLOCK))
    return whole.hexdigest()[:16] + _span(since, until)


def _span(since: float, until: float) -> str:
    if (since, until) == (0.0, float("inf")):
        return ""
    return "-" + hashlib.sha256(f"{since}\0{until}".encode()).hexdigest()[:8]


def load(root: Path, name: str, file: str = "", round: str = "") -> DumpCursor:
    """Where an import was left: at the beginning when there is no note, one of another round of
    `--again`, or one of a damaged `file` that was repaired since.
    """
    noted = notes.read(_folder(root) / f"{name}.json", DumpCursor, mend=_MEND)
    place = noted or DumpCursor(file, round=round)
    repaired = file and place.done and place.damaged and place.changed != _changed(file)
    if repaired or (round and place.round != round):
        return DumpCursor(file, round=round)
    return place


def ended(place: DumpCursor, file: Path) -> None:
    """The dump was read to its end."""
    place.done, place.changed = True, _changed(str(file))


def _changed(file: str) -> int:
    return Path(file).stat().st_mtime_ns


def save(root: Path, name: str, place: DumpCursor) -> None:
    """Write the note. Raises DiskFull."""
    write_bytes(_folder(root) / f"{name}.json", msgspec.json.encode(place))


def begun(base: Path, name: str) -> Path:
    """Where a segment is written."""
    return base / f".{name}{PART}"


def written(base: Path, segment: str) -> Path:
    """Where a whole segment waits until it is noted."""
    return base / f".{segment}{PART}"


def segment_name(number: int, digest: str) -> str:
    """By content: segments of other machines, spans and rounds in one folder have other names, or
    are the same.
    """
    return f"{number:06d}-{digest[:16]}{SUFFIX}"


def settle(root: Path) -> None:
    """Let segments appear that were noted when an import was killed, and forget what was not noted.
    Call it under the writer's lock.
    """
    base = rawlog.folder(root, "reddit", KIND)
    if not base.is_dir():
        return
    for note in sorted(_folder(root).glob("*.json")):
        if note.stem != _ROUND:
            complete(base, load(root, note.stem))
    for part in base.glob(f".*{PART}"):
        part.unlink()
    sync_folder(base)
    for lease in _folder(root).glob(f"*{_LEASE}"):
        lease.unlink()  # workers of another machine that outlived their command end


def complete(base: Path, place: DumpCursor) -> None:
    """Finish the rename that a note promises."""
    part = written(base, place.segment)
    if place.segment and part.exists() and not (base / place.segment).exists():
        os.rename(part, base / place.segment)
        sync_folder(base)


_ROUND = "again"


def begin_round(root: Path, names: Sequence[str]) -> str:
    """The round of `--again` over these notes: a new one, or the one that was stopped before its
    end.
    """
    path = _folder(root) / f"{_ROUND}.json"
    wanted = sorted(names)
    noted = notes.read(path, tuple[str, list[str]], mend=_MEND)
    if noted and noted[1] == wanted:
        return str(noted[0])
    begun = uuid.uuid4().hex[:8]
    write_bytes(path, msgspec.json.encode((begun, wanted)))
    return begun


def end_round(root: Path) -> None:
    """The round is through: the next `--again` begins another."""
    (_folder(root) / f"{_ROUND}.json").unlink(missing_ok=True)


@contextmanager
def lease(root: Path) -> Iterator[Path]:
    """A file that workers look for: when it is gone they end after the lines in hand.

    It goes at the end of the block, and as soon as the run is asked to end; it reaches other
    machines as the data root does.
    """
    path, over = _folder(root) / f"{uuid.uuid4().hex}{_LEASE}", threading.Event()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()

    def watch() -> None:
        while not over.is_set():
            if signals.stop.wait(0.1):
                path.unlink(missing_ok=True)
                return

    watcher = threading.Thread(target=watch, name="end-of-lease", daemon=True)
    watcher.start()
    try:
        yield path
    finally:
        over.set()
        path.unlink(missing_ok=True)
        watcher.join()


def _folder(root: Path) -> Path:
    return Layout(root).importing("reddit")
