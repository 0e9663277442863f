"""Which clean files an index of `kb search` was made of, and whether it still says what they say.

    index/youtube.sqlite    passages and their words (kb.search writes and reads it)
    index/youtube.json      the files of clean/youtube it was made of, by size, time and digest

An index is made again at any time, so whoever changes clean/ removes one that does not follow it
any more: a purge at once (`forget`), a filter where its files are others than before (`follow`).
Call both under the source's lock (kb.store.lock.of_clean).
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import msgspec

from kb.core.errors import DamagedData
from kb.store import complete, notes, sqlite
from kb.store.atomic import write_bytes
from kb.store.digests import digest
from kb.store.layout import Layout

TABLES = {
    "youtube": ("videos", "transcripts"),
    "wiki": ("pages", "elements", "cells", "images"),
    "reddit": ("posts", "comments"),
}
CHANGED = "its bytes are not those that were written"
_LARGE = 256 << 20  # bytes that are not read for a question
FORM = 2  # of an index; one of another form is made again

_checked: set[tuple[str, int, int, int]] = set()  # indexes that this process has read


class Stamp(msgspec.Struct):
    """A file's size in bytes, time of change in nanoseconds, and SHA-256."""

    size: int
    changed: int
    sha256: str


class Note(msgspec.Struct):
    """What an index was made of: `files` by "<table>/<name>", and `rules`, whatever else decides
    what is in it; `own`: the index itself.
    """

    rules: dict[str, Any]
    files: dict[str, Stamp]
    own: Stamp
    passages: int
    form: int = FORM


def files(root: Path, source: str) -> dict[str, Path]:
    """The clean files that an index of the source is made of. Raises DamagedData for a lost one."""
    return complete.files(root, source, TABLES[source])


def read(root: Path, source: str) -> Note | None:
    """The note beside the index; None where there is none, it can't be read, or no index is."""
    at = Layout(root)
    if not at.index(source).is_file():
        return None
    try:
        note = notes.read(at.indexed(source), Note, mend="")
    except DamagedData:
        return None  # as good as none: the index is made again
    return note if note is not None and note.form == FORM else None


def write(root: Path, source: str, note: Note) -> None:
    """Note what the index beside it was made of. Raises DiskFull."""
    write_bytes(Layout(root).indexed(source), msgspec.json.encode(note, order="sorted"))


def stamps(paths: dict[str, Path], known: dict[str, Stamp] | None = None) -> dict[str, Stamp]:
    """Stamps of files; one with the size and time of a known stamp is not read again."""
    read = {}
    for name, path in paths.items():
        about = path.stat()
        old = (known or {}).get(name)
        if old is None or (old.size, old.changed) != (about.st_size, about.st_mtime_ns):
            old = stamp(path)
        read[name] = old
    return read


def is_current(root: Path, source: str) -> bool:
    """Whether there is an index and it was made of what is in clean/ now. Raises DamagedData."""
    note = read(root, source)
    return note is not None and same(note.files, stamps(files(root, source), note.files))


def same(one: dict[str, Stamp], other: dict[str, Stamp]) -> bool:
    """Whether the files have the same names and bytes, whenever they were written."""
    return {name: stamp.sha256 for name, stamp in one.items()} == {
        name: stamp.sha256 for name, stamp in other.items()
    }


def forget(root: Path, source: str) -> None:
    """Remove the index: no byte of it stays."""
    at = Layout(root)
    for path in (at.index(source), at.indexed(source)):
        path.unlink(missing_ok=True)


def follow(root: Path, source: str) -> None:
    """Remove an index that does not say what clean/ says."""
    if not is_current(root, source):
        forget(root, source)


def check(root: Path, source: str) -> None:
    """Raises DamagedData for an index whose bytes are not those that were written.

    It is read once a process, which is not worth it for a large one that nobody has written to
    since: of that `kb verify` tells.
    """
    path, note = Layout(root).index(source), read(root, source)
    if note is None:
        return
    about = path.stat()
    mark = str(path), about.st_ino, about.st_size, about.st_mtime_ns
    touched = (note.own.size, note.own.changed) != mark[2:]
    if mark in _checked or (about.st_size > _LARGE and not touched):
        return
    if not is_whole(root, source):
        raise DamagedData(f"{path} can't be read: {CHANGED}", hint="run `kb index --again`")
    _checked.add(mark)


def is_whole(root: Path, source: str) -> bool:
    """Whether an index has the bytes that its note says."""
    path, note = Layout(root).index(source), read(root, source)
    return (
        note is not None
        and path.stat().st_size == note.own.size
        and digest(path) == note.own.sha256
    )


def stamp(path: Path) -> Stamp:
    """A file as it is now."""
    about = path.stat()
    return Stamp(about.st_size, about.st_mtime_ns, digest(path))


def problem(path: Path) -> str:
    """What is wrong with an index's file, "" when every byte of it is whole."""
    if read(path.parent.parent, path.stem) and not is_whole(path.parent.parent, path.stem):
        return CHANGED
    try:
        with contextlib.closing(sqlite.connect(path, readonly=True)) as con:
            said = str(con.execute("PRAGMA integrity_check(1)").fetchone()[0])
            con.execute("SELECT count(*) FROM passages").fetchone()
    except DamagedData as error:
        return str(error.__cause__ or error)
    return "" if said == "ok" else said
