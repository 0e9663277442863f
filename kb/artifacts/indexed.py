"""Which files an index of `kb search` was made of, and whether it still says what they say.

    index/youtube/             passages and their words (kb.search writes and reads them)
    index/youtube/note.json    the fingerprints of the files it was made of, and stamps of its own

The files are those of clean/, else what was restored or released (kb.artifacts.catalog); the index
of a download is in the user's cache. An index is made again at any time, so whoever changes clean/
removes one that is out of date: a purge at once (`forget`), a filter where its files are others
than before (`follow`).
Call both under the source's lock (kb.store.lock.of_clean).
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import msgspec

from kb.artifacts.catalog import Catalog
from kb.core.errors import DamagedData
from kb.store import notes, parquet
from kb.store.atomic import followed, write_bytes
from kb.store.checksums import digest
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


class IndexNote(msgspec.Struct):
    """What an index was made of: fingerprints of `files` by "<table>/<name>", and `rules`, whatever
    else decides what is in it; `own`: the index itself.
    """

    rules: dict[str, Any]
    files: dict[str, str]
    own: dict[str, Stamp]
    passages: int
    form: int = FORM


def files(root: Path, source: str) -> dict[str, Path]:
    """The files that an index of the source is made of, by "<table>/<name>": those of clean/, else
    the restored, else the released ones. Raises DamagedData for a lost one.
    """
    held = Catalog(root.absolute())
    return {
        f"{table}/{path.name}": path
        for table in TABLES[source]
        for path in held.texts(f"{source}/{table}")
    }


def folder(root: Path, source: str) -> Path:
    """Where the index is: below the data root, or in the cache for a download."""
    return Layout(Catalog(root.absolute()).workplace).index(source)


def read(root: Path, source: str) -> IndexNote | None:
    """The index's note; None where there is none, or it can't be read."""
    try:
        note = notes.read(folder(root, source) / NAME, IndexNote, mend="")
    except DamagedData:
        return None  # as good as none: the index is made again
    return note if note is not None and note.form == FORM else None


def write(root: Path, source: str, note: IndexNote) -> None:
    """Note what the index was made of. Raises DiskFull."""
    write_into(folder(root, source), note)


def write_into(place: Path, note: IndexNote) -> None:
    """The same for an index that is on its way in another folder."""
    write_bytes(place / NAME, msgspec.json.encode(note, order="sorted"))


def is_current(root: Path, source: str) -> bool:
    """Whether there is an index of the rows that are there now. Raises DamagedData."""
    note = read(root, source)
    return note is not None and note.files == prints(files(root, source))


def prints(paths: dict[str, Path]) -> dict[str, str]:
    """The files' fingerprints, which a copy keeps."""
    return {name: parquet.content_digest(path) for name, path in paths.items()}


def forget(root: Path, source: str) -> None:
    """Remove the index: no byte of it stays."""
    place = folder(root, source)
    (place / NAME).unlink(missing_ok=True)  # from here on there is none
    shutil.rmtree(followed(place), ignore_errors=True)
    if place.is_symlink():
        place.unlink()


def follow(root: Path, source: str) -> None:
    """Remove an index that does not say what clean/ says."""
    if not is_current(root, source):
        forget(root, source)


def check(root: Path, source: str) -> None:
    """Raises DamagedData for an index whose bytes are not those that were written.

    It is read once a process, which is not worth it for a large one that nobody has written to
    since: of that `kb verify` tells.
    """
    place, note = folder(root, source), read(root, source)
    if note is None:
        return
    there = {path.name: path.stat() for path in _files(place)}
    mark = (
        str(place),
        frozenset((name, one.st_ino, one.st_size, one.st_mtime_ns) for name, one in there.items()),
    )
    touched = {name: (one.st_size, one.st_mtime_ns) for name, one in there.items()} != {
        name: (one.size, one.changed) for name, one in note.own.items()
    }
    size = sum(one.st_size for one in there.values())
    if mark in _checked or (size > _LARGE and not touched):
        return
    if what := next((what for name in note.own if (what := _problem(place, note, name))), ""):
        if read(root, source) == note:
            raise DamagedData(what, hint="run `kb index --again`")
        check(root, source)  # it was made again meanwhile
    _checked.add(mark)


def is_whole(root: Path, source: str) -> bool:
    """Whether an index has the files and bytes that its note says, and no other."""
    place, note = folder(root, source), read(root, source)
    if note is None or {path.name for path in _files(place)} != set(note.own):
        return False
    return not any(_problem(place, note, name) for name in note.own)


def own(place: Path) -> dict[str, Stamp]:
    """The files of an index as they are now."""
    return {path.name: stamp(path) for path in _files(place)}


def _files(place: Path) -> list[Path]:
    there = sorted(place.iterdir()) if place.is_dir() else []
    return [path for path in there if path.name not in (NAME, *LOCKS)]


def stamp(path: Path) -> Stamp:
    """A file as it is now."""
    about = path.stat()
    return Stamp(about.st_size, about.st_mtime_ns, digest(path))


def problem(root: Path, source: str, name: str) -> str:
    """What is wrong with a file of an index, "" when every byte of it is whole."""
    place, note = folder(root, source), read(root, source)
    if note is None:
        return NO_NOTE
    if name not in note.own:
        return FOREIGN
    return _problem(place, note, name).removeprefix(f"{place / name} ")


def _problem(place: Path, note: IndexNote, name: str) -> str:
    path, wanted = place / name, note.own[name]
    if not path.is_file():
        return f"{path} is missing"
    if path.stat().st_size != wanted.size or digest(path) != wanted.sha256:
        return f"{path} {CHANGED}"
    return ""


def missing(root: Path, source: str) -> list[Path]:
    """Files of an index that were written and are not there."""
    place, note = folder(root, source), read(root, source)
    if note is None:
        written = place / NAME
        return [written] if place.is_dir() and _files(place) and not written.exists() else []
    return [place / name for name in sorted(note.own) if not (place / name).is_file()]
