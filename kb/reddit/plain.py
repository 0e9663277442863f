"""Comments as nearly all of them are, a column at once; anything odd is read by kb.reddit.parse.

An answer is decoded into types that hold the fields which `schemas/tables/reddit/` names in `from`
and those that its rules read, and nothing else. An answer of another form, and a comment of which a
value is not what it should be, take the careful path, field by field, to the same row.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any, Literal, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
from msgspec import UNSET, UnsetType

from kb.reddit import tree
from kb.reddit.dumps import retrieved
from kb.schema.coerce import times
from kb.schema.decode import problems
from kb.schema.tables import table

LATEST = 253402300800  # seconds of Unix time: the year 10000
_FAR = 1 << 62
NOBODY = frozenset({"", "[deleted]", "[removed]"})
# What the rules of the tables read besides the columns' own fields (kb.reddit.types, …tree).
_BY_RULES = (
    "children",
    "crosspost_parent",
    "crosspost_parent_list",
    "gallery_data",
    "is_gallery",
    "is_robot_indexable",
    "is_self",
    "is_video",
    "over_18",
    "permalink",
    "poll_data",
    "removed_by_category",
    "retrieved_on",
    "retrieved_utc",
    "url",
    "url_overridden_by_dest",
)
_GONE = frozenset({"[deleted]", "[removed]", "[ Removed by Reddit ]"})


class Listing(msgspec.Struct, gc=False):
    """A page of things; the replies to a comment are one too."""

    kind: Literal["Listing"]
    data: Children


class Children(msgspec.Struct, gc=False):
    children: list[Thing]


class Thing(msgspec.Struct, gc=False):
    """A post, a comment or a stub."""

    kind: Literal["t3", "t1", "more"]
    data: Record  # type: ignore[valid-type]


def _fields() -> list[str]:
    columns = (*table("reddit/posts").columns, *table("reddit/comments").columns)
    named = (one.source for one in columns if one.source.kind in ("posts", "comments"))
    return sorted({source.path.partition(".")[0] for source in named}.union(_BY_RULES))


Record = msgspec.defstruct(
    "Record",
    [
        *((name, Any, UNSET) for name in _fields()),
        ("replies", "Listing | str | None | UnsetType", UNSET),
    ],
    module=__name__,
    namespace={"__doc__": "The fields of a thing that are read; UNSET where it has none."},
    gc=False,
)


class _Things(msgspec.Struct, gc=False):
    things: list[Thing]


class _Data(msgspec.Struct, gc=False):
    data: _Things


class _More(msgspec.Struct, gc=False):
    json: _Data
    kind: UnsetType = UNSET


_RESPONSES: dict[str, Any] = {
    "dumps": Listing,
    "listings": Listing,
    "info": Listing,
    "comments": list[Listing] | Listing,
    "morechildren": _More,
}


class Page(NamedTuple):
    """A decoded answer of status 200 and its things, parents before replies."""

    fetched_at: str | None
    endpoint: str
    params: dict[str, Any]
    things: list[Any]


class _Request(msgspec.Struct, gc=False):
    endpoint: str
    params: dict[str, Any]


@cache
def _decoder(kind: str) -> msgspec.json.Decoder[Any]:
    return msgspec.json.Decoder(
        msgspec.defstruct(
            "Envelope",
            [
                ("fetched_at", str | None),
                ("request", _Request),
                ("status", Literal[200]),
                ("response", _RESPONSES[kind]),
            ],
        )
    )


def page(line: bytes, kind: str) -> Page | None:
    """An answer of the usual form; None for any other, which is for the careful reader."""
    if b"\\u0000" in line:
        return None
    try:
        envelope = _decoder(kind).decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    params, things = envelope.request.params, list(_walk(envelope.response))
    if "since" in params or "until" in params:
        return None  # what is outside of the span is left out, row by row
    if not all(type(one.data.id) is str and one.data.id for one in things if one.kind != "more"):
        return None  # such a thing is known by all of its fields
    return Page(envelope.fetched_at, envelope.request.endpoint, params, things)


def _walk(response: Any) -> Iterator[Any]:
    if isinstance(response, _More):
        stack: list[Any] = response.json.data.things[::-1]
    else:
        listings = response if isinstance(response, list) else [response]
        stack = [one for listing in listings for one in listing.data.children][::-1]
    while stack:
        thing = stack.pop()
        yield thing
        if thing.kind == "t1" and isinstance(thing.data.replies, Listing):
            stack.extend(reversed(thing.data.replies.data.children))


def fields_of(record: Any) -> dict[str, Any]:
    """The fields of a record as the answer's own object has them."""
    named = ((name, getattr(record, name)) for name in record.__struct_fields__)
    return {name: value for name, value in named if value is not UNSET and name != "replies"}


def is_plain(record: Any, *, escaped: bool) -> bool:
    """Whether a comment has nothing to be looked at twice: what can't be read, what is gone."""
    body, score, made = record.body, record.score, record.created_utc
    if type(body) is not str or record.title is not UNSET or record.selftext is not UNSET:
        return False
    if (html.unescape(body) if escaped and "&" in body else body) in _GONE:
        return False
    parent = record.parent_id
    if type(parent) is not str or parent[:3] not in ("t1_", "t3_"):
        return False
    if record.removed_by_category not in (UNSET, None) or record.is_robot_indexable is False:
        return False
    if score not in (UNSET, None) and (type(score) is not int or not -_FAR < score < _FAR):
        return False
    return type(made) in (int, float) and 0 <= made < LATEST


class Comments:
    """Plain comments of a batch, and where each stands among the batch's rows."""

    def __init__(self) -> None:
        self.places: list[int] = []
        self._records: list[Any] = []
        self._fetched_at: list[str | None] = []
        self._dumps: list[str] = []

    def add(self, places: list[int], records: list[Any], fetched_at: str | None, dump: str) -> None:
        """Some of one answer."""
        self.places += places
        self._records += records
        self._fetched_at += [fetched_at] * len(records)
        self._dumps += [dump] * len(records)

    def table(self, schema: pa.Schema, *, live: bool) -> pa.Table:
        """Their rows, with the columns of `schema`; what only posts have is null."""
        size = len(self._records)
        columns = []
        for field in schema:
            make = _COLUMNS.get(field.name)
            made = pa.nulls(size, field.type) if make is None else make(self, self._records, live)
            columns.append(made.cast(field.type))
        return pa.table(columns, schema=schema)

    def _when(self, records: list[Any], live: bool) -> pa.Array[Any]:
        return times(self._fetched_at)[0] if live else _moments(map(_retrieved, records))


def _texts(values: Iterable[str | None]) -> pa.Array[Any]:
    return pa.array(values, pa.string())


def _bodies(records: list[Any], live: bool) -> pa.Array[Any]:
    bodies = (one.body for one in records)
    if live:
        return _texts(bodies)
    return _texts(html.unescape(body) if "&" in body else body for body in bodies)


def _scores(records: list[Any]) -> pa.Array[Any]:
    return pa.array([None if one.score is UNSET else one.score for one in records], pa.int64())


# How each column of a batch of comments is made: (comments, their records, whether they are live).
_COLUMNS: dict[str, Callable[[Comments, list[Any], bool], pa.Array[Any]]] = {
    "fullname": lambda _, records, live: _texts(f"t1_{one.id}" for one in records),
    "post_id": lambda _, records, live: _texts(_bare(one.link_id) for one in records),
    "state": lambda _, records, live: pa.repeat("there", len(records)),
    "fetched_at": Comments._when,
    "live": lambda _, records, live: pa.repeat(pa.scalar(live), len(records)),
    "dump": lambda these, records, live: _texts(these._dumps),
    "text": lambda _, records, live: _bodies(records, live),
    "author_hash": lambda _, records, live: _texts(_author(one.author) for one in records),
    "score": lambda _, records, live: _scores(records),
    "created_utc": lambda _, records, live: _moments(int(one.created_utc) for one in records),
    "parent_id": lambda _, records, live: _texts(one.parent_id for one in records),
    "problems": lambda _, records, live: problems({}, len(records)),
}


def _moments(seconds: Iterable[int | None]) -> pa.Array[Any]:
    micros: pa.Array[Any] = pc.multiply(pa.array(seconds, pa.int64()), 1_000_000)
    return micros


def _retrieved(record: Any) -> int | None:
    """When the archive read a record; a dump's envelope holds records of different times."""
    utc, on = record.retrieved_utc, record.retrieved_on
    if utc is UNSET and type(on) is int and 0 < on < LATEST:
        return on
    return retrieved({"retrieved_utc": utc, "retrieved_on": on})


def _bare(fullname: Any) -> str:
    if type(fullname) is str and fullname[:3] == "t3_":
        return fullname[3:]
    return tree.bare(fullname)


def _author(name: Any) -> str | None:
    return name if type(name) is str and name not in NOBODY else None


def in_order(tables: Sequence[pa.Table], places: Sequence[list[int]]) -> pa.Table:
    """Rows of several tables, each at its place."""
    whole = pa.concat_tables(tables)
    at = pa.array([place for some in places for place in some], pa.int64())
    return whole.take(pc.sort_indices(at))
