"""Raw envelopes → columns, by the paths that a table's columns name in `from` and `also`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import reduce
from itertools import chain, islice, repeat
from typing import Any, NamedTuple, TypeVar

import msgspec
import pyarrow as pa

from kb.core.errors import DamagedData, SchemaMismatch
from kb.core.installation import pc
from kb.schema import raw
from kb.schema.coerce import (
    UNHOLDABLE,
    Values,
    WrongShape,
    coerce,
    in_lists,
    json_type,
    read_json,
    times,
    unreadable,
)
from kb.schema.tables import Column, Table

Row = TypeVar("Row")


JSON_BYTES = 16 << 20  # of answers that are read at once


class AnswerRows(NamedTuple):
    """An answer: when it was fetched, what was asked, and how many rows it has."""

    fetched_at: str | None
    params: dict[str, Any]
    size: int


class DecodedAnswer(NamedTuple):
    """One decoded envelope, so that Arrow can hold it; `records` are the objects that have rows."""

    fetched_at: str | None
    params: dict[str, Any]
    status: int
    records: list[Any]


class ColumnReader:
    """Reads envelopes of one raw kind into the columns of `declared` that come from it.

    `note_absent`: whether a null where none may be is a problem (not for answers that may hold
    an outcome without a row). `asked`: the parameters, all of them texts, that the rows of
    `tables` are given of what was asked.
    """

    def __init__(
        self,
        declared: Table,
        kind: str,
        *,
        note_absent: bool = True,
        asked: tuple[str, ...] = ("id",),
    ) -> None:
        self._note_absent, self._asked = note_absent, asked
        every = (*declared.columns, *declared.inputs)
        origins = [(column, origin.path) for column in every if (origin := column.origin(kind))]
        self.columns = [column for column, _ in origins]
        paths = [path for _, path in origins]
        self._schemas = [_schema(declared, kind, column, path) for column, path in origins]
        lists = {path.partition("[].")[0] if "[]." in path else "" for path in paths}
        if len(lists) > 1:
            raise SchemaMismatch(
                f"schemas/tables/{declared.name}.toml: its columns come from several lists of"
                f" {kind}: {', '.join(sorted(lists))}",
                hint="a row is made of one entry of one list",
            )
        listed = lists.pop() if len(lists) == 1 else ""
        self._listed = listed.split(".") if listed else []  # where the records stand
        self._paths = {
            column.name: path.removeprefix(f"{listed}[].").split(".") for column, path in origins
        }
        self._shape = self._json_shape()

    def answer(self, line: bytes) -> DecodedAnswer:
        """Decodes one envelope. Raises DamagedData when the line is not an envelope at all."""
        envelope = decoded(line)
        try:
            params = envelope["request"].get("params") or {}
            fetched_at, status = envelope["fetched_at"], envelope["status"]
            return self.decoded(fetched_at, params, status, envelope["response"])
        except (KeyError, TypeError, AttributeError) as error:
            raise DamagedData(f"a raw line is not an envelope: {error!r}") from None

    def values(self, name: str, records: Iterable[Any]) -> list[Any]:
        """What the records have for a column, as JSON gave it."""
        path = self._paths[name]
        return [_follow(record, path) for record in records]

    def decoded(
        self, fetched_at: str | None, params: dict[str, Any], status: int, response: Any
    ) -> DecodedAnswer:
        """The answer of a decoded envelope that was recorded, so that Arrow can hold it."""
        records: list[Any] = [response]
        if self._listed:
            items = _follow(response, self._listed)
            listed = items if isinstance(items, list) else []
            records = [item for item in listed if isinstance(item, dict)]
        return DecodedAnswer(fetched_at, params, status, records)

    def tables(self, lines: Iterable[bytes]) -> Iterator[tuple[pa.Table, list[AnswerRows]]]:
        """Batches of rows with the answers they came from, in their order.

        Columns: the reader's own, `fetched_at`, and `problems`, a list of (column, reason, value):
        `malformed` for what could not be read, `absent` for what is not there and may not be null.
        Answers whose status is not 200 are left out. Raises DamagedData.
        """
        lines = iter(lines)
        while waiting := list(_of_size(lines, JSON_BYTES)):
            rows, answers = self._batch(waiting)
            if answers:
                yield rows, answers

    def table(self, answers: list[DecodedAnswer]) -> pa.Table:
        """The columns of some answers."""
        records = list(chain.from_iterable(answer.records for answer in answers))
        values = [self.values(column.name, records) for column in self.columns]
        return self._columns(values, rows_of(answers))

    def _batch(self, lines: list[bytes]) -> tuple[pa.Table, list[AnswerRows]]:
        """Arrow reads the answers at once, unless there is something odd in one of them."""
        read = None if self._shape is None else read_json(lines, self._shape)
        made = None if read is None else self._of_json(read)
        if made is not None:
            return made
        answers = [answer for line in lines if (answer := self.answer(line)).status == 200]
        rows = [
            AnswerRows(answer.fetched_at, _given(answer.params, self._asked), len(answer.records))
            for answer in answers
        ]
        return self.table(answers), rows

    def _json_shape(self) -> pa.Schema | None:
        """The fields of an envelope that Arrow has to read, None where it can't."""
        fields: dict[str, Any] = {}
        for column, schema in zip(self.columns, self._schemas, strict=True):
            *parents, last = self._paths[column.name]
            inside = fields
            for step in parents:
                inside = inside.setdefault(step, {})
            inside[last] = json_type(column.parsed, schema)
            if inside[last] is None:
                return None
        record = _struct(fields)
        params: pa.DataType = pa.struct([(name, pa.string()) for name in self._asked])
        asked: pa.DataType = pa.struct([("params", params)])
        response: pa.DataType = pa.list_(record) if self._listed else record
        for step in reversed(self._listed):
            response = pa.struct([(step, response)])
        parts: list[tuple[str, pa.DataType]] = [("fetched_at", pa.string()), ("status", pa.int64())]
        return pa.schema([*parts, ("request", asked), ("response", response)])

    def _of_json(self, read: pa.Table) -> tuple[pa.Table, list[AnswerRows]] | None:
        """None where an envelope lacks a part, or a list of records has something else."""
        if any(read[name].null_count for name in read.column_names):
            return None
        if not pc.all(fine := pc.equal(read["status"], 200)).as_py():
            read = read.filter(fine)
        records: Any = read["response"].combine_chunks()
        sizes: Any = pa.repeat(1, read.num_rows)
        if self._listed:
            listed = reduce(_field, self._listed, records)
            sizes, records = pc.fill_null(pc.list_value_length(listed), 0), pc.list_flatten(listed)
            if records.null_count:
                return None
        values = [reduce(_field, self._paths[column.name], records) for column in self.columns]
        for n, column in enumerate(self.columns):
            if isinstance(values[n], pa.StructArray):
                if (lists := in_lists(values[n], column.parsed)) is None:
                    return None
                values[n] = lists
        params = _field(read["request"].combine_chunks(), "params").to_pylist()
        answers = [
            AnswerRows(at, _given(asked or {}, self._asked), size)
            for at, asked, size in zip(
                read["fetched_at"].to_pylist(), params, sizes.to_pylist(), strict=True
            )
        ]
        return self._columns(values, answers), answers

    def _columns(self, values: Sequence[Values], answers: list[AnswerRows]) -> pa.Table:
        data: dict[str, pa.Array[Any]] = {}
        rows = sum(answer.size for answer in answers)
        bad_cells: dict[int, list[tuple[str, str, str | None]]] = {}
        for column, schema, own in zip(self.columns, self._schemas, values, strict=True):
            array, bad = coerce(own, column.parsed, schema, clean=True)  # no text holds a NUL here
            for row, text in bad:
                bad_cells.setdefault(row, []).append((column.name, "malformed", text))
            if self._note_absent and not column.nullable and array.null_count > len(bad):
                _note_absent(array, column.name, bad_cells)
            data[column.name] = array
        moments, _ = times([answer.fetched_at for answer in answers])
        spread = chain.from_iterable(repeat(n, answer.size) for n, answer in enumerate(answers))
        data["fetched_at"] = moments.take(pa.array(list(spread), pa.int32()))
        data["problems"] = problems(bad_cells, rows)
        return pa.table(data)


def _schema(declared: Table, kind: str, column: Column, path: str) -> dict[str, Any]:
    """The schema of the field that a column is read from. Raises SchemaMismatch where a
    `ColumnReader` can't read it.
    """
    schema = raw.at(f"{declared.source}/{kind}", path)
    why = "" if schema is not None else f"schemas/raw/{declared.source}/{kind}.json has no {path}"
    if path.count("[") > 1:
        why = f"{path} is in a list within a list"
    if why := why or unreadable(column.parsed, schema or {}):
        raise SchemaMismatch(f"schemas/tables/{declared.name}.toml: column {column.name}: {why}")
    return schema or {}


def rows_of(answers: Iterable[DecodedAnswer]) -> list[AnswerRows]:
    """The same answers without what their rows are made of."""
    return [AnswerRows(answer.fetched_at, answer.params, len(answer.records)) for answer in answers]


def _given(params: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: params[name] for name in names if params.get(name) is not None}


def _struct(fields: dict[str, Any]) -> pa.DataType:
    return pa.struct(
        [(name, _struct(kind) if isinstance(kind, dict) else kind) for name, kind in fields.items()]
    )


def _field(values: Any, name: str) -> Any:
    """A field of structs; null where the struct is."""
    return pc.struct_field(values, [name])


def _of_size(lines: Iterator[bytes], size: int) -> Iterator[bytes]:
    """The next lines, until they have so many bytes."""
    for line in lines:
        yield line
        if (size := size - len(line)) <= 0:
            return


def in_batches(rows: Iterable[Row], size: int) -> Iterator[list[Row]]:
    """The rows in lists of `size`; the last one may have fewer."""
    rows = iter(rows)
    while batch := list(islice(rows, size)):
        yield batch


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


def decoded(line: bytes) -> Any:
    """The JSON of a raw line, so that Arrow can hold it. Raises DamagedData."""
    try:
        if b"\\u0000" not in line:
            return msgspec.json.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        pass
    try:
        return holdable(json.loads(line))
    except ValueError as error:
        raise DamagedData(f"a raw line is not an envelope: {error!r}") from None


def _follow(record: Any, path: list[str]) -> Any:
    for step in path:
        if record is None:
            return None
        if not isinstance(record, dict):
            return WrongShape(record)
        record = record.get(step)
    return record


def holdable(value: Any, change: Callable[[str], str] = str) -> Any:
    """The same JSON value with U+FFFD for what Arrow can't hold: NUL and lone surrogates.

    `change` is called on each text after that.
    """
    if isinstance(value, str):
        return change(UNHOLDABLE.sub("\ufffd", value))
    if isinstance(value, dict):
        return {holdable(key, change): holdable(inner, change) for key, inner in value.items()}
    if isinstance(value, list):
        return [holdable(inner, change) for inner in value]
    if isinstance(value, msgspec.Raw):
        return holdable(msgspec.json.decode(value), change)
    return value
