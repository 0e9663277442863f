"""How far each dump was imported: one note per dump and span of time, in state/reddit-import/.

A segment is written to a hidden file, renamed to its final hidden name, noted, then renamed again.
The next start completes a noted segment whose last rename is missing and deletes hidden files that
no note names, as their records are read again.
"""

import hashlib
import os
import threading
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from kb.core import signals
from kb.core.regular_file import open_regular
from kb.store.atomic import sync_folder, write_bytes
from kb.store.layout import Layout
from kb.store.leftovers import PART
from kb.store.rawlog import rawlog
from kb.store.state import json_files

KIND = "dumps"
_LEASE = ".lease"
_ROUND = "again"
_START = 1 << 16  # bytes of a dump that are compared at its beginning
_SAMPLES, _SAMPLE = 1024, 4096  # samples after it, evenly spread over the file
_REPAIR = "delete it; the dump is read once more, and existing records count once"


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
    changed: int = 0  # when the dump was last modified (ns), once it was read to its end

    @property
    def damaged(self) -> bool:
        """Whether the dump was cut off or had lines that could not be read."""
        return self.truncated or self.bad_lines > 0


def cursor_name(file: Path, since: float, until: float) -> str:
    """The name of a dump's note. It identifies a dump by its name, size and samples of its content,
    wherever it lies, and the span of time.
    """
    size = file.stat().st_size
    digest = hashlib.sha256(f"{file.name}\0{size}\0".encode())
    with open_regular(file) as opened:
        digest.update(opened.read(_START))
        step = max(_SAMPLE, (size - _START - _SAMPLE) // (_SAMPLES - 1))
        for at in (*range(_START, size - _SAMPLE, step), max(size - _SAMPLE, _START)):
            opened.seek(at)
            digest.update(opened.read(_SAMPLE))
    name = digest.hexdigest()[:16]
    if (since, until) == (0.0, float("inf")):
        return name
    span = hashlib.sha256(f"{since}\0{until}".encode()).hexdigest()
    return f"{name}-{span[:8]}"


def load_cursor(root: Path, name: str, file: str = "") -> DumpCursor:
    """Where an import stopped: at the beginning without a note, and for a damaged `file` that was
    modified since.
    """
    noted = json_files.read(_folder(root) / f"{name}.json", DumpCursor, fix=_REPAIR)
    if noted is None:
        return DumpCursor(file)
    if file and noted.done and noted.damaged and noted.changed != Path(file).stat().st_mtime_ns:
        return DumpCursor(file)
    return noted


def save_cursor(root: Path, name: str, cursor: DumpCursor) -> None:
    """Write the note. Raises DiskFull."""
    write_bytes(_folder(root) / f"{name}.json", msgspec.json.encode(cursor))


def hidden(base: Path, name: str) -> Path:
    """Where a segment is written, and under its final name waits until it is noted."""
    return base / f".{name}{PART}"


def recover_segments(root: Path) -> None:
    """Complete segments that were noted when an import was killed, and delete the others. The
    caller holds the writer's lock.
    """
    base = rawlog.folder(root, "reddit", KIND)
    if not base.is_dir():
        return
    for note in sorted(_folder(root).glob("*.json")):
        if note.stem != _ROUND:
            publish_segment(base, load_cursor(root, note.stem))
    for part in base.glob(f".*{PART}"):
        part.unlink()
    sync_folder(base)
    for lease in _folder(root).glob(f"*{_LEASE}"):
        lease.unlink()  # stops workers on other machines that outlived their command


def publish_segment(base: Path, cursor: DumpCursor) -> None:
    """Rename a noted segment to its final name. Where one of that name is there, it has the same
    content: `--again` reads what was imported before.
    """
    part = hidden(base, cursor.segment)
    if not cursor.segment or not part.exists():
        return
    if (base / cursor.segment).exists():
        part.unlink()
    else:
        os.rename(part, base / cursor.segment)
    sync_folder(base)


def begin_round(root: Path, names: Iterable[str]) -> None:
    """Begin the round of `--again` over these notes, which are removed; a round of the same ones
    that was interrupted goes on instead.
    """
    path, names = _folder(root) / f"{_ROUND}.json", sorted(names)
    if json_files.read(path, list[Any], fix=_REPAIR) == names:
        return
    for name in names:
        (_folder(root) / f"{name}.json").unlink(missing_ok=True)
    write_bytes(path, msgspec.json.encode(names))


def end_round(root: Path) -> None:
    """The round is complete: the next `--again` begins another."""
    (_folder(root) / f"{_ROUND}.json").unlink(missing_ok=True)


@contextmanager
def lease(root: Path) -> Iterator[Path]:
    """A file that workers check: once it is deleted they stop after the lines in hand.

    It is deleted at the end of the block and as soon as the run is asked to stop. As part of the
    data root it reaches workers on other machines.
    """
    path, over = _folder(root) / f"{uuid.uuid4().hex}{_LEASE}", threading.Event()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()

    def watch() -> None:
        while not over.wait(0.1):
            if signals.stop.requested():
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
