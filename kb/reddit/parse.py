"""Raw answers of Reddit, live or from dumps, of any year → rows of things.

One row a post, comment, stub or missing id. Fields drift over the years (recorded answers of 2016
to 2026 are in the tests); what can't be read is null and named in `problems`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import cache, partial
from typing import Any

import msgspec
import pyarrow as pa

from kb.core.errors import DamagedData
from kb.core.profile.reddit import Links
from kb.reddit import fields, plain, tree
from kb.reddit.dumps import retrieved
from kb.reddit.types import is_crosspost, link_classifier, poll_options, post_type, removal
from kb.schema.coerce import times
from kb.schema.decode import holdable, problems
from kb.schema.tables import table
from kb.store.buckets import Kind

ROWS = 8_192
# Of answers that are as old the later kind counts: a refresh (info) reads again what others
# brought.
KINDS = ("dumps", "listings", "comments", "morechildren", "info")
MARKS = READ, OPEN = "read", "open"  # states of rows that are no things: see `_marks`

Row = dict[str, Any]


def raw_kind(kind: str, links: Links) -> Kind:
    """How one raw kind becomes rows; of records of dumps that are as old, or don't say, the later
    dump's counts.
    """
    return Kind(
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
        self._read = Reader(kind, links)
        self._plain = plain.Comments()
        self._rows: list[Row] = []
        self._places: list[int] = []  # of `_rows`
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def add(self, line: bytes) -> None:
        """Read one envelope. Raises DamagedData when it is none."""
        page = plain.page(line, self._kind)
        if page is None:
            self._careful(self._read.envelope(line, marks=True))
        else:
            self._page(page)

    def _careful(self, found: list[Row]) -> None:
        self._places += range(self._size, self._size + len(found))
        self._rows += found
        self._size += len(found)

    def _page(self, page: plain.Page) -> None:
        params, dump = page.params, self._read.dump(page.endpoint, page.params)
        about = _about(params)
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
            known.update(row["fullname"] for row in found)
            self._careful(self._read.told(found, page.fetched_at, dump))
        self._plain.add(places, quick, page.fetched_at, dump)
        known.update(f"t1_{record.id}" for record in quick)
        asked = asked_for(self._kind, params, 200)
        found = [_row(name, post, "missing") for name, post in asked if name not in known]
        found += _marks(self._kind, stubs, params, 200)
        self._careful(self._read.told(found, page.fetched_at, dump))

    def table(self) -> pa.Table:
        """The rows, in their order."""
        columns = self._plain.table(self._schema, live=self._live)
        if not self._rows:
            return columns
        others = to_table(self._rows, self._schema)
        return plain.in_order((columns, others), (self._plain.places, self._places))


class Reader:
    """Reads the envelopes of one kind into plain rows."""

    def __init__(self, kind: str, links: Links) -> None:
        self._kind = kind
        self._live = kind != "dumps"
        self._classify: Callable[[str], str] = link_classifier(links)

    def envelope(self, line: bytes, *, marks: bool = False) -> list[Row]:
        """The rows of one line, with `marks` those too. Raises DamagedData when it is no
        envelope.
        """
        try:
            envelope = msgspec.json.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError):
            try:
                envelope = holdable(json.loads(line))  # lone surrogates, which Arrow can't hold
            except ValueError as error:
                raise DamagedData(f"a raw line is no envelope: {error}") from None
        fetched_at, params, status = (
            envelope["fetched_at"],
            envelope["request"]["params"],
            envelope["status"],
        )
        things = list(tree.things(envelope["response"])) if status == 200 else []
        about = _about(params)
        found = [row for thing in things for row in self.of_thing(thing, about)]
        if self._kind == "listings":
            # A crawl of a span of time leaves out what its listings show of other times.
            found = [
                row
                for row in found
                if not tree.outside(
                    row.get("created_utc"), params.get("since"), params.get("until")
                )
            ]
        known = {row["fullname"] for row in found}
        asked = asked_for(self._kind, params, status)
        found += [_row(name, post, "missing") for name, post in asked if name not in known]
        if marks:
            found += _marks(self._kind, things, params, status)
        return self.told(found, fetched_at, self.dump(envelope["request"]["endpoint"], params))

    def dump(self, endpoint: str, params: dict[str, Any]) -> str:
        """Where a record of a dump stands; empty for live answers."""
        return "" if self._live else f"{endpoint}/{params.get('offset', 0):020d}"

    def told(self, found: list[Row], fetched_at: str | None, dump: str) -> list[Row]:
        """The rows with what the envelope says of all of them."""
        for row in found:
            # A dump's envelope holds records that were read at different times; each says it
            # itself, or nobody knows.
            row["fetched_at"] = fetched_at if self._live else row.pop("retrieved", None)
            row["live"], row["dump"] = self._live, dump
        return found

    def of_thing(self, thing: tree.Thing, about: str) -> Iterator[Row]:
        """The rows of a post, a comment or a stub; `about`: the post that stubs are of."""
        kind, data = thing
        if kind == tree.POST:
            yield self.post(data)
        elif kind == tree.COMMENT:
            yield self.comment(data)
        else:
            yield from (_row(f"t1_{key}", about, "stub") for key in tree.stub_ids(data))

    def post(self, data: dict[str, Any]) -> Row:
        """The row of a post (a submission's fields of any year)."""
        if not self._live:
            data = fields.unescaped(data)
        row, key = _identified("t3", data)
        row["post_id"] = key
        kind, link_kind, url = post_type(data, self._classify)
        row |= {
            "type": kind,
            "link_kind": link_kind,
            "source_url": url,
            "is_crosspost": is_crosspost(data),
            "poll_options": poll_options(data),
            "over_18": fields.flag(row, data, "over_18"),
            "title": fields.text(row, data, "title", needed=True),
            "text": fields.text(row, data, "selftext") or None,
            "num_comments": fields.integer(row, data, "num_comments"),
            "upvote_ratio": fields.ratio(row, data),
        }
        return _common(row, data)

    def comment(self, data: dict[str, Any]) -> Row:
        """The row of a comment."""
        if not self._live:
            data = fields.unescaped(data)
        row, _ = _identified("t1", data)
        row["post_id"] = tree.bare(data.get("link_id"))
        parent = data.get("parent_id")
        if not isinstance(parent, str) or not parent.startswith(("t1_", "t3_")):
            # Some dump years give the parent of a comment as a number or leave it out.
            row["found"].append(
                (
                    "parent_id",
                    "absent" if parent is None else "malformed",
                    None if parent is None else str(parent),
                )
            )
            parent = None
        row |= {"parent_id": parent, "text": fields.text(row, data, "body", needed=True)}
        return _common(row, data)


def asked_for(kind: str, params: dict[str, Any], status: int) -> list[tuple[str, str]]:
    """(full name, bare post id) of what a request named, for telling what is missing.

    A post's page that answers 404 or 410 means that the post is gone.
    """
    if kind == "info" and status == 200:
        names = [name for name in str(params.get("id", "")).split(",") if name]
        posts = params.get("posts") or []
        return [
            (
                name,
                tree.bare(name) if name.startswith("t3_") else (posts[n] if n < len(posts) else ""),
            )
            for n, name in enumerate(names)
        ]
    if kind == "morechildren" and status == 200:
        post = tree.bare(params.get("link_id"))
        return [(f"t1_{key}", post) for key in str(params.get("children", "")).split(",") if key]
    if (
        kind == "comments"
        and status in (404, 410)
        and "comment" not in params
        and params.get("article")
    ):
        return [(f"t3_{params['article']}", str(params["article"]))]
    return []


def _about(params: dict[str, Any]) -> str:
    """The post that an answer is of: stubs don't say it, the request does."""
    return params.get("article") or tree.bare(params.get("link_id"))


def _marks(
    kind: str, things: Iterable[tree.Thing], params: dict[str, Any], status: int
) -> Iterator[Row]:
    """Rows that say which parts of a tree are known: `read` the page of a post or of a comment's
    thread, `open` the comment whose replies are behind "continue this thread".
    """
    post = str(params.get("article") or tree.bare(params.get("link_id")))
    if kind == "comments" and post and status in (200, 404, 410):  # what is gone has nothing unread
        comment = params.get("comment")
        yield _row(f"t1_{comment}" if comment else f"t3_{post}", post, READ)
    if kind not in ("comments", "morechildren") or status != 200:
        return
    for thing in things:
        if thing.kind != "more" or not tree.is_continuation(thing.data):
            continue
        if thing.data["parent_id"].startswith("t1_"):
            yield _row(thing.data["parent_id"], post, OPEN)


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


def _row(fullname: str, post: str, state: str) -> Row:
    return {"fullname": fullname, "post_id": post, "state": state, "found": []}


def _identified(kind: str, data: dict[str, Any]) -> tuple[Row, str]:
    """A row under the thing's id. One without an id can't be told from others: it gets a made-up
    key and is rejected.
    """
    key = data.get("id")
    if isinstance(key, str) and key:
        return _row(f"{kind}_{key}", "", "there"), key
    made = (
        "unknown-"
        + hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]
    )
    row = _row(f"{kind}_{made}", "", "unknown")
    row["found"].append(
        ("state", "malformed" if key is not None else "absent", None if key is None else str(key))
    )
    return row, made


def _common(row: Row, data: dict[str, Any]) -> Row:
    gone = removal(data)
    author = data.get("author")
    row["retrieved"] = _retrieved(data)
    row |= {
        "score": fields.integer(row, data, "score"),
        "created_utc": fields.integer(row, data, "created_utc"),
        "author_hash": author if isinstance(author, str) and author not in plain.NOBODY else None,
        "gone": gone[0] if gone else None,
        "gone_value": gone[1] if gone else None,
    }
    if row["created_utc"] is not None and not 0 <= row["created_utc"] < plain.LATEST:
        row["found"].append(("created_utc", "malformed", str(data.get("created_utc"))))
        row["created_utc"] = None
    return row


def _retrieved(data: dict[str, Any]) -> str | None:
    at = retrieved(data)
    return None if at is None else datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
