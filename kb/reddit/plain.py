"""Comments as nearly all of them are, a column at once; anything odd is read by kb.reddit.parse.

An answer is decoded into types that hold the fields which `schemas/tables/reddit/` names in `from`
and those that its rules read, and nothing else. An answer of another form, and a comment of which a
value is not what it should be, take the careful path, field by field, to the same row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
from msgspec import UNSET

from kb.reddit import forms, tree
from kb.reddit.dumps import LATEST
from kb.reddit.entities import unescaped
from kb.schema.coerce import times
from kb.schema.decode import problems
from kb.schema.tables import table

_FAR = 1 << 62
NOBODY = frozenset({"", "[deleted]", "[removed]"})
# What the rules of the tables read besides the columns' own fields (kb.reddit.types, …tree).
_OF_ALL = (
    "is_robot_indexable",
    "removed_by_category",
    "retrieved_on",
    "retrieved_utc",
    "selftext",
    "title",
)
_OF_POSTS = (
    "body",
    "crosspost_parent",
    "crosspost_parent_list",
    "gallery_data",
    "is_gallery",
    "is_self",
    "is_video",
    "over_18",
    "permalink",
    "poll_data",
    "url",
    "url_overridden_by_dest",
)
_GONE = frozenset({"[deleted]", "[removed]", "[ Removed by Reddit ]"})


def _record(name: str, *fields: str, **more: Any) -> type[msgspec.Struct]:
    """The fields of a thing that are read; UNSET where it has none."""
    read = [(field, Any, UNSET) for field in sorted({"id", *fields})]
    typed = [(field, kind, UNSET) for field, kind in more.items()]
    return msgspec.defstruct(name, [*read, *typed], module=__name__, gc=False)


def _columns(of: str) -> list[str]:
    named = (column.source for column in table(f"reddit/{of}").columns)
    return [source.path.partition(".")[0] for source in named if source.kind == of]


PostFields = _record("PostFields", *_columns("posts"), *_OF_ALL, *_OF_POSTS)
CommentFields = _record(
    "CommentFields",
    *_columns("comments"),
    *_OF_ALL,
    replies="forms.ListingForm[Thing] | str | None | msgspec.UnsetType",
)
StubFields = _record("StubFields", "children", "parent_id")


class PostRecord(msgspec.Struct, gc=False, tag_field="kind", tag="t3"):
    """A post."""

    kind: ClassVar[str] = tree.POST
    data: PostFields  # type: ignore[valid-type]


class CommentRecord(msgspec.Struct, gc=False, tag_field="kind", tag="t1"):
    """A comment with its replies."""

    kind: ClassVar[str] = tree.COMMENT
    data: CommentFields  # type: ignore[valid-type]


class StubRecord(msgspec.Struct, gc=False, tag_field="kind", tag="more"):
    """What stands for comments that the answer has not."""

    kind: ClassVar[str] = "more"
    data: StubFields  # type: ignore[valid-type]


Thing = PostRecord | CommentRecord | StubRecord


class DecodedPage(NamedTuple):
    """A decoded answer of status 200 and its things, parents before replies."""

    fetched_at: str | None
    endpoint: str
    params: dict[str, Any]
    things: list[Any]


def page(line: bytes, kind: str) -> DecodedPage | None:
    """An answer of the usual form; None for any other, which is for the careful reader."""
    if b"\\u0000" in line:
        return None
    try:
        envelope = forms.decoder(kind, Thing).decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    things = forms.things_of(envelope)
    if things is None:
        return None
    for one in things:
        key = one.data.id
        if (type(key) is not str or not key) and one.kind != "more":
            return None  # such a thing is known by all of its fields
    return DecodedPage(
        envelope.fetched_at, envelope.request.endpoint, envelope.request.params, things
    )


def fields_of(record: Any) -> dict[str, Any]:
    """The fields of a record as the answer's own object has them."""
    fields = msgspec.structs.asdict(record)
    fields.pop("replies", None)
    return {name: value for name, value in fields.items() if value is not UNSET}


def is_plain(record: Any, *, escaped: bool) -> bool:
    """Whether a comment has nothing to be looked at twice: what can't be read, what is gone."""
    body, score, made = record.body, record.score, record.created_utc
    if type(body) is not str or record.title is not UNSET or record.selftext is not UNSET:
        return False
    if (unescaped(body) if escaped else body) in _GONE:
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
        if live:
            return times(self._fetched_at)[0]
        return _micros(pa.array(list(map(forms.read_at, records)), pa.int64()))


def _texts(values: Iterable[str | None]) -> pa.Array[Any]:
    return pa.array(values, pa.string())


def _field(records: list[Any], name: str) -> pa.Array[Any] | None:
    """A field of all records as text, null where it is null; None where one is something else."""
    try:
        return pa.array(list(map(attrgetter(name), records)), pa.string())
    except (pa.ArrowTypeError, pa.ArrowInvalid):
        return None


def _bodies(records: list[Any], live: bool) -> pa.Array[Any]:
    bodies = map(attrgetter("body"), records)
    if live:
        return _texts(list(bodies))
    return _texts(list(map(unescaped, bodies)))


def _posts(records: list[Any]) -> pa.Array[Any]:
    links = _field(records, "link_id")
    if links is None or not pc.all(pc.fill_null(pc.starts_with(links, "t3_"), False)).as_py():
        return _texts([tree.bare(one.link_id) for one in records])
    posts: pa.Array[Any] = pc.utf8_slice_codeunits(links, 3)
    return posts


def _authors(records: list[Any]) -> pa.Array[Any]:
    names = _field(records, "author")
    if names is None:
        names = _texts([one.author if type(one.author) is str else None for one in records])
    nobody = pc.is_in(names, value_set=pa.array(NOBODY, pa.string()))
    known: pa.Array[Any] = pc.if_else(nobody, pa.scalar(None, pa.string()), names)
    return known


def _scores(records: list[Any]) -> pa.Array[Any]:
    return pa.array([None if one.score is UNSET else one.score for one in records], pa.int64())


def _made(records: list[Any]) -> pa.Array[Any]:
    seconds = pa.array(list(map(attrgetter("created_utc"), records)), pa.float64())
    return _micros(seconds.cast(pa.int64(), safe=False))  # what is behind the point is left out


def _micros(seconds: pa.Array[Any]) -> pa.Array[Any]:
    micros: pa.Array[Any] = pc.multiply(seconds, 1_000_000)
    return micros


# How each column of a batch of comments is made: (comments, their records, whether they are live).
_COLUMNS: dict[str, Callable[[Comments, list[Any], bool], pa.Array[Any]]] = {
    "fullname": lambda _, records, live: _texts([f"t1_{one.id}" for one in records]),
    "post_id": lambda _, records, live: _posts(records),
    "state": lambda _, records, live: pa.repeat("there", len(records)),
    "fetched_at": Comments._when,
    "live": lambda _, records, live: pa.repeat(pa.scalar(live), len(records)),
    "dump": lambda these, records, live: _texts(these._dumps),
    "text": lambda _, records, live: _bodies(records, live),
    "author_hash": lambda _, records, live: _authors(records),
    "score": lambda _, records, live: _scores(records),
    "created_utc": lambda _, records, live: _made(records),
    "parent_id": lambda _, records, live: _texts(list(map(attrgetter("parent_id"), records))),
    "problems": lambda _, records, live: problems({}, len(records)),
}


def in_order(tables: Sequence[pa.Table], places: Sequence[list[int]]) -> pa.Table:
    """Rows of several tables, each at its place."""
    whole = pa.concat_tables(tables)
    at = pa.array([place for some in places for place in some], pa.int64())
    return whole.take(pc.sort_indices(at))
