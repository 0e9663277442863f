"""Raw envelopes → columns, by the paths that a table's columns name in `from` and `also`.

A msgspec type with exactly those fields is derived from the TOML, so decoding skips all else. Its
leaves take any value: a retyped field costs one value, never an envelope. An envelope whose
objects are not objects, or whose text JSON can't hold, is read the slow way, which takes more.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from itertools import chain, repeat
from operator import attrgetter
from typing import Any, NamedTuple

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.errors import DamagedData
from kb.schema import raw
from kb.schema.coerce import WrongShape, coerce, times
from kb.schema.struct_lists import texts, verbatim
from kb.schema.tables import Column, Table

_UNHOLDABLE = re.compile("[\x00\ud800-\udfff]")
_NULL = msgspec.Raw(b"null")


class DecodedAnswer(NamedTuple):
    """One decoded envelope; its records have the reader's fields and no others."""

    fetched_at: str | None
    params: dict[str, Any]
    status: int
    records: list[Any]


class ColumnReader:
    """Reads envelopes of one raw kind into the columns of `declared` that come from it.

    `note_absent`: whether a null where none may be is a problem (not for answers that may hold
    an outcome without a row). Lists of fixed rows stay as they are in the answer, as JSON text:
    kb.schema.struct_lists makes columns of them.
    """

    def __init__(self, declared: Table, kind: str, *, note_absent: bool = True) -> None:
        self._note_absent = note_absent
        every = (*declared.columns, *declared.inputs)
        origins = [(column, origin) for column in every if (origin := column.origin(kind))]
        self.columns: list[Column] = [column for column, _ in origins]
        self._kind = f"{declared.source}/{kind}"
        paths = [origin.path for _, origin in origins]
        self._listed = all(path.startswith("items[].") for path in paths)
        self._paths = [
            path.removeprefix("items[].").split(".") if self._listed else path.split(".")
            for path in paths
        ]
        self._schemas = [raw.at(self._kind, path) or {} for path in paths]
        self._verbatim = [_is_records(column) for column in self.columns]
        response = self._record = _struct("Record", _tree(self._paths, self._verbatim))
        if self._listed:
            items: Any = ("items", list[response], msgspec.field(default_factory=list))  # type: ignore[valid-type]
            response = msgspec.defstruct("Response", [items])
        request = msgspec.defstruct(
            "Request", [("params", dict[str, Any], msgspec.field(default_factory=dict))]
        )
        envelope = msgspec.defstruct(
            "Envelope",
            [
                ("fetched_at", str | None),
                ("request", request),
                ("status", int),
                ("response", response),
            ],
        )
        self._decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(envelope)
        self._take = [attrgetter(".".join(path)) for path in self._paths]

    def answer(self, line: bytes) -> DecodedAnswer:
        """Decodes one envelope. Raises DamagedData when the line is no envelope at all."""
        if b"\\u0000" not in line:
            try:
                got = self._decoder.decode(line)
            except (msgspec.DecodeError, UnicodeDecodeError):
                pass
            else:
                records = got.response.items if self._listed else [got.response]
                return DecodedAnswer(got.fetched_at, got.request.params, got.status, records)
        return self._patient(line)

    def values(self, name: str, records: Iterable[Any]) -> list[Any]:
        """What the records have for a column, as JSON gave it."""
        places = (place for place, column in enumerate(self.columns) if column.name == name)
        return list(map(self._take[next(places)], records))

    def _patient(self, line: bytes) -> DecodedAnswer:
        try:
            envelope = json.loads(line)
            fetched_at, status = envelope["fetched_at"], envelope["status"]
            params, response = envelope["request"].get("params") or {}, envelope["response"]
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DamagedData(f"a raw line is not an envelope: {error!r}") from None
        return self.decoded(fetched_at, holdable(params), status, holdable(response))

    def decoded(
        self, fetched_at: str | None, params: dict[str, Any], status: int, response: Any
    ) -> DecodedAnswer:
        """The answer of a decoded envelope that was recorded, so that Arrow can hold it."""
        records: list[Any] = [response]
        if self._listed:
            items = response.get("items") if isinstance(response, dict) else None
            records = (
                [item for item in items if isinstance(item, dict)]
                if isinstance(items, list)
                else []
            )
        return DecodedAnswer(fetched_at, params, status, [self._made(record) for record in records])

    def _made(self, record: Any) -> Any:
        """A decoded object as a record."""
        made = self._record()
        for path, is_records in zip(self._paths, self._verbatim, strict=True):
            value = _follow(record, path)
            inner = made
            for step in path[:-1]:
                inner = getattr(inner, step)
            setattr(inner, path[-1], verbatim(value) if is_records else value)
        return made

    def tables(
        self, lines: Iterable[bytes], rows: int
    ) -> Iterator[tuple[pa.Table, list[DecodedAnswer]]]:
        """Batches of about `rows` rows with the answers they came from.

        Columns: the reader's own, `fetched_at`, and `problems`, a list of (column, reason, value):
        `malformed` for what could not be read, `absent` for what is not there and may not be null.
        Answers whose status is not 200 are left out.
        """
        waiting: list[DecodedAnswer] = []
        size = 0
        for line in lines:
            answer = self.answer(line)
            if answer.status != 200:
                continue
            waiting.append(answer)
            size += max(1, len(answer.records))
            if size >= rows:
                yield self.table(waiting), waiting
                waiting, size = [], 0
        if waiting:
            yield self.table(waiting), waiting

    def table(self, answers: list[DecodedAnswer]) -> pa.Table:
        """The columns of some answers."""
        records = list(chain.from_iterable(answer.records for answer in answers))
        data: dict[str, pa.Array[Any]] = {}
        bad_cells: dict[int, list[tuple[str, str, str | None]]] = {}
        for number, (column, schema) in enumerate(zip(self.columns, self._schemas, strict=True)):
            values = list(map(self._take[number], records))
            if self._verbatim[number]:
                data[column.name] = texts(values)
                continue
            array, bad = coerce(values, column.parsed, schema, clean=True)  # answer() saw to it
            for row, text in bad:
                bad_cells.setdefault(row, []).append((column.name, "malformed", text))
            if self._note_absent and not column.nullable and array.null_count > len(bad):
                _note_absent(array, column.name, bad_cells)
            data[column.name] = array
        moments, _ = times([answer.fetched_at for answer in answers])
        spread = pa.array(
            list(chain.from_iterable(repeat(n, len(one.records)) for n, one in enumerate(answers))),
            pa.int32(),
        )
        data["fetched_at"] = moments.take(spread)
        data["problems"] = problems(bad_cells, len(records))
        return pa.table(data)


def problems(entries: dict[int, list[tuple[str, str, str | None]]], size: int) -> pa.Array[Any]:
    """The `problems` column of `size` rows from (column, reason, value) triples by row."""
    names = ("column", "reason", "value")
    offsets: list[int] = [0]
    flat: list[tuple[str, str, str | None]] = []
    for row in sorted(entries):
        offsets += [len(flat)] * (row + 1 - len(offsets))  # the rows before it have none
        flat += entries[row]
        offsets.append(len(flat))
    offsets += [len(flat)] * (size + 1 - len(offsets))
    columns = [pa.array([item[place] for item in flat], pa.string()) for place in range(len(names))]
    struct = pa.StructArray.from_arrays(columns, names=list(names))
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), struct)


def _note_absent(
    array: pa.Array[Any], name: str, bad_cells: dict[int, list[tuple[str, str, str | None]]]
) -> None:
    rows: list[int] = pc.indices_nonzero(pc.is_null(array)).to_pylist()
    for row in rows:
        if not any(column == name for column, _, _ in bad_cells.get(row, ())):
            bad_cells.setdefault(row, []).append((name, "absent", None))


def _is_records(column: Column) -> bool:
    item = column.parsed.item
    return item is not None and bool(item.fields)


def _tree(paths: list[list[str]], verbatim: list[bool]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for path, is_records in zip(paths, verbatim, strict=True):
        node = tree
        for step in path[:-1]:
            node = node.setdefault(step, {})
        node[path[-1]] = msgspec.Raw if is_records else Any
    return tree


def _struct(name: str, tree: dict[str, Any]) -> type[msgspec.Struct]:
    fields: list[Any] = []
    for key, below in tree.items():
        if below is msgspec.Raw:
            fields.append((key, below, _NULL))
        elif below is Any:
            fields.append((key, below, None))
        else:
            inner = _struct(key.capitalize(), below)
            fields.append((key, inner, msgspec.field(default_factory=inner)))
    return msgspec.defstruct(name, fields, gc=False)


def _follow(record: Any, path: list[str]) -> Any:
    for step in path:
        if record is None:
            return None
        if not isinstance(record, dict):
            return WrongShape(record)
        record = record.get(step)
    return record


def holdable(value: Any) -> Any:
    """The same JSON value with U+FFFD for what Arrow can't hold: NUL and lone surrogates."""
    if isinstance(value, str):
        return _UNHOLDABLE.sub("\ufffd", value)
    if isinstance(value, dict):
        return {holdable(key): holdable(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [holdable(inner) for inner in value]
    return value
