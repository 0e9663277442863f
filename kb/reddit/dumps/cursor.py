"""How far each dump was imported: one note per dump and span of time, in state/reddit-import/.

Which dump a note is about, kb.reddit.dumps.known_dumps tells.

A segment is written to a hidden file, renamed to its final hidden name, noted, then renamed again.
The next start completes a noted segment whose last rename is missing and deletes hidden files that
no note names, as their records are read again.
"""

import os
import threading
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from kb.core import signals
from kb.store.atomic import sync_folder, write_bytes
from kb.store.damage import read_note
from kb.store.layout import Layout
from kb.store.leftovers import PART
from kb.store.rawlog import rawlog

KIND = "dumps"
_LEASE = ".lease"
_ROUND = "again"
_REPAIR = "delete it; the dump is read once more, and existing records count once"


class DumpCursor(msgspec.Struct):
    """How far a dump was imported. `offset` in decompressed bytes; `segment` the last one noted.

    `size`, `samples` and `sha256` are of the file as it lies; the digest is "" until the file was
    read to its end, and for one that was cut off.
    """

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
    size: int = 0
    samples: str = ""
    sha256: str = ""


def load_cursor(root: Path, name: str, file: str = "") -> DumpCursor:
    """Where an import stopped: at the beginning without a note."""
    return find_cursor(root, name) or DumpCursor(file)


def find_cursor(root: Path, name: str) -> DumpCursor | None:
    """The note of that name, None where there is none."""
    return read_note(_folder(root) / f"{name}.json", DumpCursor, fix=_REPAIR)


def cursors(root: Path) -> dict[str, DumpCursor]:
    """Every note by its name."""
    names = (path.stem for path in sorted(_folder(root).glob("*.json")))
    return {name: load_cursor(root, name) for name in names if name != _ROUND}


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
    for cursor in cursors(root).values():
        publish_segment(base, cursor)
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
    if read_note(path, list[Any], fix=_REPAIR) == names:
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
