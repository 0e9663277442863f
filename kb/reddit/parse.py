"""Raw answers of Reddit, live or from dumps, of any year → rows of things.

One row a post, comment, stub or missing id. Fields drift over the years (recorded answers of 2016
to 2026 are in the tests); what can't be read is null and named in `problems`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache, partial
from typing import Any

import pyarrow as pa

from kb.core.profile.reddit import Links
from kb.reddit import plain, tree
from kb.reddit.records import RecordReader, Row, about_of, asked_for, marked, row_of
from kb.schema.coerce import times
from kb.schema.decode import problems
from kb.schema.tables import table
from kb.store.buckets import RawKind

ROWS = 8_192
# Of answers that are as old the later kind counts: a refresh (info) reads again what others
# brought.
KINDS = ("dumps", "listings", "comments", "morechildren", "info")


def raw_kind(kind: str, links: Links) -> RawKind:
    """How one raw kind becomes rows; of records of dumps that are as old, or don't say, the later
    dump's counts.
    """
    return RawKind(
        partial(rows, kind=kind, links=links),
        key=("fullname", "state"),
        bucket="post_id",
        then="dump",
    )


def rows(
    lines: Iterable[bytes], kind: str, links: Links, only: tuple[str, ...] = ()
) -> Iterator[pa.Table]:
    """Envelopes of one raw kind → tables of about 8,192 rows with the columns of `schema()`, or
    with `only` some of them.
    """
    batch = Batch(kind, links, only)
    for line in lines:
        batch.add(line)
        if len(batch) >= ROWS:
            yield batch.table()
            batch = Batch(kind, links, only)
    if len(batch):
        yield batch.table()


class Batch:
    """Rows of some answers, in their order: plain comments as columns, all else field by field."""

    def __init__(self, kind: str, links: Links, only: tuple[str, ...] = ()) -> None:
        self._schema = pa.schema([field for field in schema() if not only or field.name in only])
        self._kind, self._live = kind, kind != "dumps"
        self._read = RecordReader(kind, links)
        self._plain = plain.Comments()
        self._rows: list[Row] = []
        self._places: list[int] = []  # of `_rows`
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def add(self, line: bytes) -> None:
        """Read one envelope. Raises DamagedData for any other line."""
        page = plain.page(line, self._kind)
        if page is None:
            self._careful(self._read.envelope(line, marks=True))
        else:
            self._page(page)

    def _careful(self, found: list[Row]) -> None:
        self._places += range(self._size, self._size + len(found))
        self._rows += found
        self._size += len(found)

    def _page(self, page: plain.DecodedPage) -> None:
        params, dump = page.params, self._read.dump(page.endpoint, page.params)
        about, asked = about_of(params), asked_for(self._kind, params, 200)
        quick: list[Any] = []
        places: list[int] = []
        known: set[str] = set()
        stubs: list[tree.Thing] = []
        escaped = not self._live
        for one in page.things:
            kind, record = one.kind, one.data
            if kind == tree.COMMENT and plain.is_plain(record, escaped=escaped):
                quick.append(record)
                places.append(self._size)
                self._size += 1
                continue
            thing = tree.Thing(kind, plain.fields_of(record))
            if kind not in (tree.COMMENT, tree.POST):
                stubs.append(thing)
            found = list(self._read.of_thing(thing, about))
            if asked:
                known.update(row["fullname"] for row in found)
            self._careful(self._read.told(found, page.fetched_at, dump))
        self._plain.add(places, quick, page.fetched_at, dump)
        if asked:
            known.update(f"t1_{record.id}" for record in quick)
        found = [row_of(name, post, "missing") for name, post in asked if name not in known]
        found += marked(self._kind, stubs, params, 200)
        self._careful(self._read.told(found, page.fetched_at, dump))

    def table(self) -> pa.Table:
        """The rows, in their order."""
        columns = self._plain.table(self._schema, live=self._live)
        if not self._rows:
            return columns
        others = to_table(self._rows, self._schema)
        return plain.in_order((columns, others), (self._plain.places, self._places))


@cache
def schema() -> pa.Schema:
    """Columns of `rows`: those of the tables as declared, and what only stages read."""
    text, flag = pa.string(), pa.bool_()
    problem = pa.struct([("column", text), ("reason", text), ("value", text)])
    return pa.schema(
        [
            ("fullname", text),
            _declared("post_id"),
            ("state", text),
            _declared("fetched_at"),
            ("live", flag),
            ("dump", text),
            *map(_declared, ("type", "link_kind", "source_url", "is_crosspost", "poll_options")),
            ("over_18", flag),
            _declared("title"),
            ("text", _declared("body")[1]),
            *map(_declared, ("author_hash", "score", "num_comments", "upvote_ratio")),
            _declared("created_utc"),
            _declared("parent_id"),
            ("gone", text),
            ("gone_value", text),
            ("problems", pa.list_(problem)),
        ]
    )


def _declared(name: str) -> tuple[str, pa.DataType]:
    """A column of posts or comments with its type."""
    of = "posts" if name in table("reddit/posts").names() else "comments"
    return name, table(f"reddit/{of}").column(name).parsed.arrow()


def to_table(found: list[Row], made: pa.Schema | None = None) -> pa.Table:
    """Plain rows as a table of `schema()`, or of some of its columns."""
    columns: dict[str, Any] = {}
    made = made or schema()
    for field in made:
        if field.name == "fetched_at":
            columns[field.name] = times([row.get("fetched_at") for row in found])[0].cast(
                field.type
            )
        elif field.name == "created_utc":
            # whole seconds to microseconds
            columns[field.name] = pa.array(
                [
                    None if (at := row.get("created_utc")) is None else at * 1_000_000
                    for row in found
                ],
                pa.int64(),
            ).cast(field.type)
        elif field.name == "problems":
            columns[field.name] = problems(
                {n: row["found"] for n, row in enumerate(found) if row["found"]}, len(found)
            ).cast(field.type)
        else:
            columns[field.name] = pa.array([row.get(field.name) for row in found], field.type)
    return pa.table(columns, schema=made)
