"""What refresh and purge go by, read out of raw answers without their texts: which things an answer
shows or misses, of which post, when it was read, and why a thing is gone.

The same rows as kb.reddit.parse makes, some of their columns. An answer of the usual form is
decoded into types that hold the few fields which that takes; any other is read by kb.reddit.parse.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Literal

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
from msgspec import UNSET, Raw, UnsetType

from kb.core.profile.reddit import Links
from kb.reddit import entities, forms, parse, tree
from kb.reddit.records import asked_for
from kb.reddit.types import removal
from kb.schema.coerce import times

COLUMNS = ("fullname", "post_id", "state", "fetched_at", "live", "gone", "dump")
_ABSENT = Raw(b"")
# How a text begins that can't say that a thing is gone; what says so begins with a bracket, maybe
# escaped.
_PLAIN = frozenset(b'"' + bytes([one]) for one in range(256) if one not in b"[\\&")


class _Thing(msgspec.Struct, gc=False):
    kind: Literal["t3", "t1", "more"]
    data: _Data


class _Data(msgspec.Struct, gc=False):
    id: Any = None
    link_id: Any = None
    children: Any = None
    retrieved_utc: Any = UNSET
    retrieved_on: Any = UNSET
    removed_by_category: Any = UNSET
    is_robot_indexable: Any = UNSET
    title: Raw = _ABSENT
    selftext: Raw = _ABSENT
    body: Raw = _ABSENT
    author: Raw = _ABSENT
    replies: forms.ListingForm[_Thing] | str | UnsetType | None = UNSET


def rows(lines: Iterable[bytes], kind: str, links: Links) -> Iterator[pa.Table]:
    """Envelopes of one raw kind → tables of about 8,192 rows with `COLUMNS`, in their order:
    things that are there or missing and have an id. Raises DamagedData for any other line.
    """
    batch, odd = _Batch(kind), list[bytes]()
    for line in lines:
        if not batch.add(line):
            yield from batch.tables()
            odd.append(line)
            if len(odd) < parse.ROWS:
                continue
        if odd:
            yield from _carefully(odd, kind, links)
            odd = []
        if batch.size >= parse.ROWS:
            yield from batch.tables()
    yield from _carefully(odd, kind, links)
    yield from batch.tables()


def _carefully(lines: list[bytes], kind: str, links: Links) -> Iterator[pa.Table]:
    good = pa.array(["there", "missing"])
    for found in parse.rows(lines, kind, links, COLUMNS):
        yield found.filter(pc.is_in(found["state"], value_set=good))


class _Batch:
    """Columns of some answers."""

    def __init__(self, kind: str) -> None:
        self._kind, self._live = kind, kind != "dumps"
        self._decode = forms.decoder(kind, _Thing).decode
        self._schema = pa.schema([field for field in parse.schema() if field.name in COLUMNS])
        self._clear()

    def _clear(self) -> None:
        self.size = 0
        self._names: list[str] = []
        self._posts: list[str] = []
        self._there: list[bool] = []
        self._gone: list[str | None] = []
        self._read: list[int | None] = []  # of dumps, in seconds of Unix time
        self._answers: list[tuple[str | None, str]] = []  # when, and the place in a dump
        self._of: list[int] = []  # the answer of each row

    def add(self, line: bytes) -> bool:
        """Read one envelope; False: it is of another form."""
        try:
            answer = self._decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return False
        things, params = forms.things_of(answer), answer.request.params
        if things is None:
            return False
        shown = [one for one in things if one.kind != "more"]
        stubs = [one for one in things if one.kind == "more"]
        records = [one.data for one in shown]
        if not all(type(one.id) is str and one.id for one in records):
            return False
        self._names += [f"{one.kind}_{one.data.id}" for one in shown]
        self._posts += [
            one.data.id if one.kind == tree.POST else tree.bare(one.data.link_id) for one in shown
        ]
        self._there += [True] * len(shown)
        escaped = not self._live
        self._gone += [None if _is_plain(one) else _gone(one, escaped=escaped) for one in records]
        place, found = "", len(shown)
        if self._live:
            found += self._missing(asked_for(self._kind, params, 200), found, stubs)
        else:
            self._read += map(forms.read_at, records)
            place = f"{answer.request.endpoint}/{params.get('offset', 0):020d}"
        self._of += [len(self._answers)] * found
        self._answers.append((answer.fetched_at, place))
        self.size += found
        return True

    def _missing(self, asked: list[tuple[str, str]], shown: int, stubs: list[Any]) -> int:
        """Rows of what was asked for and is not among the last `shown` rows nor behind stubs."""
        if not asked:
            return 0
        known = set(self._names[len(self._names) - shown :])
        for stub in stubs:
            known.update(f"t1_{key}" for key in tree.stub_ids({"children": stub.data.children}))
        missing = [(name, post) for name, post in asked if name not in known]
        self._names += [name for name, _ in missing]
        self._posts += [post for _, post in missing]
        self._there += [False] * len(missing)
        self._gone += [None] * len(missing)
        return len(missing)

    def tables(self) -> Iterator[pa.Table]:
        """What was read since the last time."""
        if not self.size:
            return
        of = pa.array(self._of, pa.int64())
        if self._live:
            at = times([when for when, _ in self._answers])[0].take(of)
        else:
            at = pc.multiply(pa.array(self._read, pa.int64()), 1_000_000)
        columns = {
            "fullname": pa.array(self._names, pa.string()),
            "post_id": pa.array(self._posts, pa.string()),
            "state": pc.if_else(pa.array(self._there), "there", "missing"),
            "fetched_at": at,
            "live": pa.repeat(pa.scalar(self._live), self.size),
            "gone": pa.array(self._gone, pa.string()),
            "dump": pa.array([place for _, place in self._answers], pa.string()).take(of),
        }
        made = [columns[field.name].cast(field.type) for field in self._schema]
        self._clear()
        yield pa.table(made, schema=self._schema)


def _gone(data: Any, *, escaped: bool) -> str | None:
    """Why a thing is gone, as kb.reddit.types says; None: it is not."""
    names = ("title", "selftext", "body", "author")
    said = {name: msgspec.json.decode(raw) for name in names if (raw := getattr(data, name))}
    for name in ("removed_by_category", "is_robot_indexable"):
        if (value := getattr(data, name)) is not UNSET:
            said[name] = value
    why = removal(entities.resolve(said) if escaped else said)
    return why[0] if why else None


def _is_plain(data: Any) -> bool:
    """Whether nothing of a record can say that the thing is gone."""
    return (
        (data.removed_by_category is None or data.removed_by_category is UNSET)
        and data.is_robot_indexable is not False
        and memoryview(data.selftext or data.body)[:2].tobytes() in _PLAIN
        and (not data.title or memoryview(data.title)[:2].tobytes() in _PLAIN)
    )
