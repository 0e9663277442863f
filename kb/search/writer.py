"""Writes an index, with the threads and merges of tantivy's own writer.

Which passages share a segment is chance. No answer depends on it: statistics are of all segments,
and passages with equal scores are sorted by the number that they have here.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import orjson
import tantivy

from kb.core.errors import DiskFull
from kb.search.analysis import analyzer
from kb.search.engine import (
    ANALYZER,
    DAY,
    KEY,
    KIND,
    NUMBER,
    ROW,
    THING,
    WORDS,
    PassageIndex,
    day,
    schema,
)
from kb.search.passage import KINDS, Passage
from kb.store.atomic import FULL_HINT

_HEAP = 128 << 20  # bytes that all threads of a writer may take before they write a segment
_THREADS = 2  # on any machine, so that the memory is the same
_AT_ONCE = 4_096  # passages between two reports of progress
_LEAST_ROOM = 64 << 20  # bytes; where less is left on the disk, that is why a writer failed


def write(
    folder: Path,
    stemmer: str,
    passages: Iterable[Passage],
    advance: Callable[[int], object],
    heap: int = _HEAP,
) -> int:
    """Write an index of passages into an empty folder and return how many they are.

    `advance` is called with the number of passages written since the last call. The passages of
    one thing come together. Raises DiskFull.
    """
    index = tantivy.Index(schema(), path=str(folder))
    index.register_tokenizer(ANALYZER, analyzer(stemmer))
    count = reported = things = 0
    thing = None
    with _checking_disk(folder):
        writer = index.writer(heap_size=heap, num_threads=_THREADS)
        for count, passage in enumerate(passages, 1):
            things += passage.thing != thing
            thing = passage.thing
            writer.add_document(_document(passage, count, things))
            if count - reported == _AT_ONCE:
                advance(_AT_ONCE)
                reported = count
        writer.commit()
        writer.wait_merging_threads()
    advance(count - reported)
    written = PassageIndex(folder, stemmer).size
    assert written == count, f"{written} of {count} passages in {folder}"
    return count


def _document(passage: Passage, number: int, thing: int) -> tantivy.Document:
    made = tantivy.Document()
    for text in (passage.title, passage.title, passage.path, passage.text, passage.alt):
        if text:
            made.add_text(WORDS, text)
    made.add_text(KEY, passage.key)
    made.add_integer(KIND, KINDS.index(passage.kind))
    made.add_integer(NUMBER, number)
    made.add_integer(THING, thing)
    if passage.date:
        made.add_integer(DAY, day(passage.date))
    made.add_bytes(ROW, orjson.dumps(tuple(passage)))
    return made


@contextlib.contextmanager
def _checking_disk(folder: Path) -> Iterator[None]:
    """tantivy says only that a thread of it failed."""
    try:
        yield
    except ValueError as error:
        if shutil.disk_usage(folder).free < _LEAST_ROOM:
            raise DiskFull(f"no room to write {folder}", hint=FULL_HINT) from error
        raise
