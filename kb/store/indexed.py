"""Which clean files an index of `kb search` was made of, and whether it still says what they say.

    index/youtube/             passages and their words (kb.search writes and reads them)
    index/youtube/note.json    the files of clean/youtube it was made of, by size, time and digest,
                               and so its own

An index is made again at any time, so whoever changes clean/ removes one that does not follow it
any more: a purge at once (`forget`), a filter where its files are others than before (`follow`).
Call both under the source's lock (kb.store.lock.of_clean).
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import msgspec

from kb.core.errors import DamagedData
from kb.store import complete, notes
from kb.store.atomic import followed, write_bytes
from kb.store.digests import digest
from kb.store.layout import Layout

TABLES = {
    "youtube": ("videos", "transcripts"),
    "wiki": ("pages", "elements", "cells", "images"),
    "reddit": ("posts", "comments"),
}
NAME = "note.json"
CHANGED = "can't be read: its bytes are not those that were written"
FOREIGN = "no command has written it"
NO_NOTE = "nothing says what its bytes were"
LOCKS = (".tantivy-meta.lock", ".tantivy-writer.lock")  # empty; no part of what an index says
_LARGE = 256 << 20  # bytes that are not read for a question
FORM = 4  # of an index; one of another form is made again

_checked: set[tuple[str, frozenset[tuple[str, int, int, int]]]] = set()  # what this process read


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
    own: dict[str, Stamp]
    passages: int
    form: int = FORM


def files(root: Path, source: str) -> dict[str, Path]:
    """The clean files that an index of the source is made of. Raises DamagedData for a lost one."""
    return complete.files(root, source, TABLES[source])


def read(root: Path, source: str) -> Note | None:
    """The index's note; None where there is none, or it can't be read."""
    try:
        note = notes.read(Layout(root).indexed(source), Note, mend="")
    except DamagedData:
        return None  # as good as none: the index is made again
    return note if note is not None and note.form == FORM else None


def write(root: Path, source: str, note: Note) -> None:
    """Note what the index was made of. Raises DiskFull."""
    write_into(Layout(root).index(source), note)


def write_into(folder: Path, note: Note) -> None:
    """The same for an index that is on its way in another folder."""
    write_bytes(folder / NAME, msgspec.json.encode(note, order="sorted"))


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
    folder = Layout(root).index(source)
    Layout(root).indexed(source).unlink(missing_ok=True)  # from here on there is none
    shutil.rmtree(followed(folder), ignore_errors=True)
    if folder.is_symlink():
        folder.unlink()


def follow(root: Path, source: str) -> None:
    """Remove an index that does not say what clean/ says."""
    if not is_current(root, source):
        forget(root, source)


def check(root: Path, source: str) -> None:
    """Raises DamagedData for an index whose bytes are not those that were written.

    It is read once a process, which is not worth it for a large one that nobody has written to
    since: of that `kb verify` tells.
    """
    folder, note = Layout(root).index(source), read(root, source)
    if note is None:
        return
    there = {path.name: path.stat() for path in _files(folder)}
    mark = (
        str(folder),
        frozenset((name, one.st_ino, one.st_size, one.st_mtime_ns) for name, one in there.items()),
    )
    touched = {name: (one.st_size, one.st_mtime_ns) for name, one in there.items()} != {
        name: (one.size, one.changed) for name, one in note.own.items()
    }
    size = sum(one.st_size for one in there.values())
    if mark in _checked or (size > _LARGE and not touched):
        return
    if what := next((what for name in note.own if (what := _problem(folder, note, name))), ""):
        if read(root, source) == note:
            raise DamagedData(what, hint="run `kb index --again`")
        check(root, source)  # it was made again meanwhile
    _checked.add(mark)


def is_whole(root: Path, source: str) -> bool:
    """Whether an index has the files and bytes that its note says, and no other."""
    folder, note = Layout(root).index(source), read(root, source)
    if note is None or {path.name for path in _files(folder)} != set(note.own):
        return False
    return not any(_problem(folder, note, name) for name in note.own)


def own(folder: Path) -> dict[str, Stamp]:
    """The files of an index as they are now."""
    return {path.name: stamp(path) for path in _files(folder)}


def _files(folder: Path) -> list[Path]:
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    return [path for path in there if path.name not in (NAME, *LOCKS)]


def stamp(path: Path) -> Stamp:
    """A file as it is now."""
    about = path.stat()
    return Stamp(about.st_size, about.st_mtime_ns, digest(path))


def problem(root: Path, source: str, name: str) -> str:
    """What is wrong with a file of an index, "" when every byte of it is whole."""
    folder, note = Layout(root).index(source), read(root, source)
    if note is None:
        return NO_NOTE
    if name not in note.own:
        return FOREIGN
    return _problem(folder, note, name).removeprefix(f"{folder / name} ")


def _problem(folder: Path, note: Note, name: str) -> str:
    path, wanted = folder / name, note.own[name]
    if not path.is_file():
        return f"{path} is missing"
    if path.stat().st_size != wanted.size or digest(path) != wanted.sha256:
        return f"{path} {CHANGED}"
    return ""


def missing(root: Path, source: str) -> list[Path]:
    """Files of an index that were written and are not there."""
    folder, note = Layout(root).index(source), read(root, source)
    if note is None:
        place = Layout(root).indexed(source)
        return [place] if folder.is_dir() and _files(folder) and not place.exists() else []
    return [folder / name for name in sorted(note.own) if not (folder / name).is_file()]
