"""Raw answers of Reddit, live or from dumps, of any year → rows of posts and comments.

One row per post, comment, stub or missing id. Fields drift over the years (the tests use recorded
answers of 2016 to 2026); a value that can't be read is null and named in `problems`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from functools import cache, partial
from itertools import chain
from typing import Any, TypedDict

import msgspec
import pyarrow as pa

from kb.core.errors import DamagedData
from kb.reddit.parse import answer_tree
from kb.reddit.parse.records import RecordReader, Row, new_row
from kb.reddit.section import Links
from kb.schema.coerce import times
from kb.schema.decode import holdable, in_batches, problems
from kb.schema.tables import table
from kb.store.tables.partition import RawKind

ROWS = 8_192
# Of answers of the same age the later kind counts: a refresh (info) reads again what others
# brought.
KINDS = ("dumps", "listings", "comments", "morechildren", "info")
MARKS = READ, OPEN = "read", "open"  # states of rows that are no things: see `_marks`
# Of several copies of a record in dumps the one counts that is the greatest in these columns. A
# removal at an unknown moment is undone by no copy, as none is known to be newer; otherwise the
# newest copy counts, of equal ones a removal, then the later dump's. A live answer is compared with
# the copy that counts, by `fetched_at` alone: a newer one that shows a text has the last word.
COPIES = ("undated", "fetched_at", "gone", "dump")


def raw_kind(kind: str, links: Links) -> RawKind:
    """How one raw kind becomes rows, of which the newest counts (see `COPIES`)."""
    return RawKind(
        partial(rows, kind=kind, links=links),
        key=("fullname", "state"),
        bucket="post_id",
        by=COPIES if kind == "dumps" else ("fetched_at",),
    )


def rows(lines: Iterable[bytes], kind: str, links: Links) -> Iterator[pa.Table]:
    """Envelopes of one raw kind → tables of about 8,192 rows with the columns of `schema()`.

    Raises DamagedData for a line that is not an envelope.
    """
    reader = RecordReader(links, live=kind != "dumps")
    every = chain.from_iterable(_rows_of(line, kind, reader) for line in lines)
    for batch in in_batches(every, ROWS):
        yield _to_table(batch, live=kind != "dumps")


def _rows_of(line: bytes, kind: str, reader: RecordReader) -> list[Row]:
    """The rows of one envelope, in the order of the answer."""
    envelope = _decode(line)
    params, status = envelope["request"]["params"], envelope["status"]
    things = list(answer_tree.things(envelope["response"])) if status == 200 else []
    if not all(isinstance(key := thing.data.get("id"), str) and key for thing in things):
        # The key of a record without an id is made of everything in it.
        things = list(answer_tree.things(_decode(line, whole=True)["response"]))
    post = str(params.get("article") or answer_tree.bare(params.get("link_id")))
    records: list[Row] = []
    for thing in things:
        if thing.kind == answer_tree.COMMENT:
            records.append(reader.comment(thing.data))
        elif thing.kind == answer_tree.POST:
            records.append(reader.post(thing.data))
        else:  # a stub does not name its post, the request does
            records += [
                new_row(f"t1_{key}", post, "stub") for key in answer_tree.stub_ids(thing.data)
            ]
    if kind == "listings":
        # A crawl of a span of time leaves out what its listings show of other times.
        since, until = params.get("since"), params.get("until")
        records = [
            row for row in records if not answer_tree.outside(row.get("created_utc"), since, until)
        ]
    if asked := _asked_for(kind, params, status):
        known = {row["fullname"] for row in records}
        records += [new_row(name, of, "missing") for name, of in asked if name not in known]
    records += _marks(kind, things, params, post, status)
    if kind == "dumps":
        # The records of such an envelope were read at different times; each has its own.
        place = f"{envelope['request']['endpoint']}/{params.get('offset', 0):020d}"
        for row in records:
            row["dump"] = place
    else:
        for row in records:
            row["fetched_at"] = envelope["fetched_at"]
    return records


def _decode(line: bytes, *, whole: bool = False) -> dict[str, Any]:
    """The envelope of a line, with the fields of `_Node` alone unless it is wanted `whole` or has
    another form. Raises DamagedData.
    """
    try:
        envelope = (_WHOLE if whole else _DECODER).decode(line)
    except msgspec.ValidationError:
        return _decode(line, whole=True)
    except (msgspec.DecodeError, UnicodeDecodeError):
        try:
            envelope = holdable(json.loads(line))  # lone surrogates, which Arrow can't hold
        except ValueError as error:
            raise DamagedData(f"a raw line is not a valid envelope: {error}") from None
    return dict(envelope)


class _Node(TypedDict, total=False):
    """What is read of an object of an answer, a listing or a record; the rest is passed over."""

    # How answers are nested (answer_tree)
    kind: Any
    data: _Node
    children: list[_Node | str]
    replies: _Node | str | None
    json: _Node
    things: list[_Node]
    # A record (records, removal)
    id: Any
    link_id: Any
    parent_id: Any
    title: Any
    selftext: Any
    body: Any
    author: Any
    score: Any
    created_utc: Any
    num_comments: Any
    upvote_ratio: Any
    over_18: Any
    url: Any
    url_overridden_by_dest: Any
    permalink: Any
    is_self: Any
    is_video: Any
    is_gallery: Any
    gallery_data: Any
    poll_data: Any
    crosspost_parent: Any
    crosspost_parent_list: Any
    removed_by_category: Any
    is_robot_indexable: Any
    retrieved_on: Any
    retrieved_utc: Any
    _meta: Any


class _Envelope(TypedDict, total=False):
    fetched_at: Any
    request: Any
    status: Any
    response: _Node | list[_Node] | str | None


_DECODER, _WHOLE = msgspec.json.Decoder(_Envelope), msgspec.json.Decoder()


def _asked_for(kind: str, params: dict[str, Any], status: int) -> list[tuple[str, str]]:
    """(full name, bare post id) of what a request named: what the answer lacks is missing.

    A post's page that answers 404 or 410 means that the post is gone.
    """
    if kind == "info" and status == 200:
        names = [name for name in str(params.get("id", "")).split(",") if name]
        posts = [*(params.get("posts") or ()), *[""] * len(names)]
        return [
            (name, answer_tree.bare(name) if name.startswith("t3_") else post)
            for name, post in zip(names, posts, strict=False)
        ]
    if kind == "morechildren" and status == 200:
        post = answer_tree.bare(params.get("link_id"))
        return [(f"t1_{key}", post) for key in str(params.get("children", "")).split(",") if key]
    if kind == "comments" and status in (404, 410) and "comment" not in params:
        post = str(params.get("article") or "")
        return [(f"t3_{post}", post)] if post else []
    return []


def _marks(
    kind: str, things: list[answer_tree.Thing], params: dict[str, Any], post: str, status: int
) -> Iterator[Row]:
    """Rows that say which parts of a tree are known: `read` the page of a post or of a comment's
    thread, `open` the comment whose replies are behind "continue this thread".
    """
    if kind == "comments" and post and status in (200, 404, 410):  # a deleted post is fully read
        comment = params.get("comment")
        yield new_row(f"t1_{comment}" if comment else f"t3_{post}", post, READ)
    if kind in ("comments", "morechildren"):
        for thing in things:
            if thing.kind == "more" and answer_tree.is_continuation(thing.data):
                parent = thing.data["parent_id"]
                if parent.startswith("t1_"):
                    yield new_row(parent, post, OPEN)


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
            ("undated", flag),
            ("problems", pa.list_(problem)),
        ]
    )


def _declared(name: str) -> tuple[str, pa.DataType]:
    """A column of posts or comments with its type."""
    of = "posts" if name in table("reddit/posts").names() else "comments"
    return name, table(f"reddit/{of}").column(name).parsed.arrow()


def _to_table(records: list[Row], *, live: bool) -> pa.Table:
    """Rows as a table of `schema()`."""
    noted = {number: row["problems"] for number, row in enumerate(records) if row["problems"]}
    special: dict[str, Any] = {
        "live": pa.repeat(pa.scalar(live), len(records)),
        "dump": pa.array([row.get("dump", "") for row in records], pa.string()),
        "fetched_at": times([row.get("fetched_at") for row in records])[0]
        if live
        else _seconds([row.get("retrieved") for row in records]),
        "created_utc": _seconds([row.get("created_utc") for row in records]),
        # What is read live is of the moment of its answer.
        "undated": pa.array([not live and row.get("undated", False) for row in records]),
        "problems": problems(noted, len(records)),
    }
    plain = [field for field in schema() if field.name not in special]
    # Arrow looks the fields up itself.
    read: Any = pa.array(records, pa.struct(plain))
    columns = [
        special[field.name].cast(field.type) if field.name in special else read.field(field.name)
        for field in schema()
    ]
    return pa.table(columns, schema=schema())


def _seconds(values: list[int | None]) -> pa.Array[Any]:
    return pa.array(values, pa.int64()).cast(pa.timestamp("s")).cast(pa.timestamp("us"))
