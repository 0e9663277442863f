"""Writes an index.

The same passages give the same bytes. Whole threads, pages and videos go to two writers in turn,
on any machine; each has a thread of its own and begins a new index before its words fill the memory
that it has. So every one of these becomes one segment, none is ever merged with another (when that
happens is chance), and all are put together to one index, under numbers instead of drawn names.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import uuid
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import orjson
import tantivy

from kb.core.errors import DiskFull
from kb.search.analysis import Words
from kb.search.engine import DAY, KEY, KIND, ROW, THING, WORDS, Opened, day, schema
from kb.search.passage import KINDS, Passage
from kb.store.atomic import FULL_HINT

_META, _PARTS = "meta.json", "parts"
_WRITERS = 2
_AT_ONCE = 4_096  # passages whose words are looked up together
_PART = 64 << 20  # characters of a segment's words; they take about as many bytes of memory
_HEAP = 256 << 20  # bytes that a writer may take; full, it would begin a second segment
_LEAST_ROOM = 64 << 20  # bytes; where less is left on the disk, that is why a writer failed


def write(
    folder: Path, stemmer: str, passages: Iterable[Passage], told: Callable[[int], object]
) -> int:
    """An index of passages into an empty folder; how many they were. `told` hears of more of them.

    The passages of a thing come together. Raises DiskFull.
    """
    parts, words = folder / _PARTS, Words(stemmer)
    writers = [_Writer(parts / str(number), words) for number in range(_WRITERS)]
    count, number, thing = 0, -1, None
    rest = iter(passages)
    with _full_disk_is_told(folder):
        while some := list(islice(rest, _AT_ONCE)):
            for one, text in zip(some, words.texts([one.text for one in some]), strict=True):
                number += one.thing != thing
                thing = one.thing
                writers[number % _WRITERS].add(one, text, number)
            count += len(some)
            told(len(some))
        _put_together(folder, [part for one in writers for part in one.end()], count)
    shutil.rmtree(parts)
    return count


class _Writer:
    """Writes index after index, each of which is one segment."""

    def __init__(self, parts: Path, words: Words) -> None:
        self._parts, self._words = parts, words
        self._done = self._held = 0
        self._writer: tantivy.IndexWriter | None = None

    def add(self, one: Passage, text: str, thing: int) -> None:
        """A passage, its text's words and the number of its thing."""
        if self._writer is None or self._held > _PART:
            self._begin()
        assert self._writer is not None
        title = self._words.line(one.title)
        path, alt = self._words.line(one.path), self._words.line(one.alt)
        self._writer.add_document(_document(one, (title, title, path, text, alt), thing))
        self._held += 2 * len(title) + len(path) + len(text) + len(alt)

    def _begin(self) -> None:
        self._finish()
        folder = self._folder(self._done)
        folder.mkdir(parents=True)
        index = tantivy.Index(schema(), path=str(folder))
        self._writer, self._held = index.writer(heap_size=_HEAP, num_threads=1), 0

    def _finish(self) -> None:
        if self._writer is not None:
            self._writer.commit()
            self._writer.wait_merging_threads()
            self._writer, self._done = None, self._done + 1

    def end(self) -> list[Path]:
        """The indexes in the order in which they were written; at least one."""
        if self._writer is None:
            self._begin()
        self._finish()
        return [self._folder(number) for number in range(self._done)]

    def _folder(self, number: int) -> Path:
        return self._parts / str(number)


def _document(one: Passage, words: Iterable[str], thing: int) -> tantivy.Document:
    made = tantivy.Document()
    for some in words:
        if some:
            made.add_text(WORDS, some)
    made.add_text(KEY, one.key)
    made.add_integer(KIND, KINDS.index(one.kind))
    made.add_integer(THING, thing)
    if one.date:
        made.add_integer(DAY, day(one.date))
    made.add_bytes(ROW, orjson.dumps(tuple(one)))
    return made


def _put_together(folder: Path, parts: list[Path], count: int) -> None:
    """Every part's segments to one index, under numbers for names."""
    segments: list[dict[str, Any]] = []
    meta: dict[str, Any] = {}
    for part in parts:
        meta = json.loads((part / _META).read_text(encoding="utf-8"))
        for one in sorted(meta["segments"], key=lambda one: -one["max_doc"]):
            name, number = uuid.UUID(one["segment_id"]).hex, uuid.UUID(int=len(segments) + 1)
            for path in part.glob(f"{name}.*"):
                os.rename(path, folder / f"{number.hex}{path.suffix}")
            segments.append({**one, "segment_id": str(number)})
    meta |= {"segments": segments, "opstamp": count}
    (folder / _META).write_text(json.dumps(meta, indent=1), encoding="utf-8")
    written = Opened(folder, "").size
    assert written == count, f"{written} of {count} passages in {folder}"


@contextlib.contextmanager
def _full_disk_is_told(folder: Path) -> Iterator[None]:
    """tantivy says only that a thread of it failed."""
    try:
        yield
    except ValueError as error:
        if shutil.disk_usage(folder).free < _LEAST_ROOM:
            raise DiskFull(f"no room to write {folder}", hint=FULL_HINT) from error
        raise
