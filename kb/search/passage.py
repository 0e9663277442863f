"""Passages: the units that `kb search` indexes and shows, each with its source."""

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from kb.artifacts.table_catalog import Catalog
from kb.core import scripts
from kb.schema import table
from kb.store.tables import parquet
from kb.store.tables.merge import Merge
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import order

MOST_WORDS = 200  # of a passage's text
_AT_ONCE = 64  # rows as Python objects at a time: a transcript is a large one
_AHEAD = 1_024  # of all files: a transcript has tens of kilobytes
_NOT_SHOWN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")  # marks of snippets would be among them


class Passage(NamedTuple):
    """A piece of text of a video, page, post or comment, which `key` identifies.

    By default a search returns one passage of each `thing`: video, page or thread. `path` is a
    section's headings. `times` are the start seconds of a transcript's cues, which are the lines of
    the text.
    """

    kind: str
    key: str
    thing: str
    title: str
    text: str
    url: str
    date: str | None
    licence: str | None = None
    path: str = ""
    alt: str = ""
    times: Sequence[float] = ()


def plain(text: str | None) -> str:
    """A text without control characters, with composed accents; "" for None."""
    if not text:
        return ""
    if not text.isascii():
        text = unicodedata.normalize("NFC", text)
    return text if text.isprintable() else _NOT_SHOWN.sub(" ", text)


def day(when: Any) -> str | None:
    """The date of a time: "2026-03-01"."""
    return None if when is None else when.date().isoformat()


def rows(root: Path, name: str, columns: list[str]) -> Iterator[dict[str, Any]]:
    """The rows of a declared table in its order, a few at a time.

    Those of clean/, else the restored, else the released ones, with nulls for columns that these
    lack. Raises DamagedData.
    """
    for part in batches(root, name, columns):
        yield from part.to_pylist()


def batches(root: Path, name: str, columns: list[str]) -> Iterator[pa.Table]:
    """The same as Arrow tables of a few rows."""
    catalog, declared = Catalog(root.absolute()), table(name)
    files = catalog.texts(name)
    with reading(files):
        names = set(columns).intersection(*(parquet.names(path) for path in files))
    there = [column for column in columns if column in names]
    scratch = None if catalog.is_writable else catalog.cached
    merge = Merge(files, order(declared), there, ahead=_AHEAD, scratch=scratch)
    with closing(merge) as merged:
        for part in merged:
            made = part
            for column in set(columns).difference(there):
                empty = pa.nulls(part.num_rows, declared.arrow().field(column).type)
                made = made.append_column(column, empty)
            for start in range(0, part.num_rows, _AT_ONCE):
                yield made.select(columns).slice(start, _AT_ONCE)


def pieces(lines: Iterable[str], most: int = MOST_WORDS) -> Iterator[str]:
    """Lines joined to texts of at most `most` words; a longer line is divided."""
    pending: list[str] = []
    count = 0
    for line in lines:
        divided = scripts.parts(line, most)
        for part, words in divided if len(divided) > 1 else [(line, sum(n for _, n in divided))]:
            if pending and count + words > most:
                yield "\n".join(pending)
                pending, count = [], 0
            pending.append(part)
            count += words
    if pending:
        yield "\n".join(pending)
