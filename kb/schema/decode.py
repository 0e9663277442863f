"""Raw envelopes → columns, by the paths that a table's columns name in `from` and `also`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, islice, repeat
from typing import Any, NamedTuple, TypeVar

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.errors import DamagedData
from kb.schema import raw
from kb.schema.coerce import UNHOLDABLE, WrongShape, coerce, times
from kb.schema.tables import Table

Row = TypeVar("Row")


class _Envelope(msgspec.Struct):
    """An envelope whose response is an object, each value of which is still JSON text."""

    fetched_at: str | None
    request: dict[str, Any]
    status: int
    response: dict[str, msgspec.Raw]


_ENVELOPE = msgspec.json.Decoder(_Envelope)


class DecodedAnswer(NamedTuple):
    """One decoded envelope, so that Arrow can hold it; `records` are the objects that have rows.
    In these, lists of records may be JSON text (bytes).
    """

    fetched_at: str | None
    params: dict[str, Any]
    status: int
    records: list[Any]


class ColumnReader:
    """Reads envelopes of one raw kind into the columns of `declared` that come from it.

    `note_absent`: whether a null where none may be is a problem (not for answers that may hold
    an outcome without a row).
    """

    def __init__(self, declared: Table, kind: str, *, note_absent: bool = True) -> None:
        self._note_absent = note_absent
        every = (*declared.columns, *declared.inputs)
        origins = [(column, origin.path) for column in every if (origin := column.origin(kind))]
        self.columns = [column for column, _ in origins]
        paths = [path for _, path in origins]
        self._listed = all(path.startswith("items[].") for path in paths)
        self._paths = {
            column.name: path.removeprefix("items[].").split(".") for column, path in origins
        }
        # Lists of records stay JSON text, which Arrow reads without making objects of Python.
        self._texts = {
            path
            for column, path in origins
            if column.parsed.item is not None and column.parsed.item.fields
        }
        self._schemas = [raw.at(f"{declared.source}/{kind}", path) or {} for path in paths]

    def answer(self, line: bytes) -> DecodedAnswer:
        """Decodes one envelope. Raises DamagedData when the line is not an envelope at all."""
        if self._texts and b"\\u0000" not in line:
            try:
                late = _ENVELOPE.decode(line.decode())
            except (msgspec.DecodeError, UnicodeDecodeError):
                pass  # what is odd about it is found below
            else:
                response = {
                    name: bytes(value)
                    if name in self._texts and bytes(value) != b"null"
                    else msgspec.json.decode(value)
                    for name, value in late.response.items()
                }
                params = late.request.get("params") or {}
                return self.decoded(late.fetched_at, params, late.status, response)
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
            items = response.get("items") if isinstance(response, dict) else None
            listed = items if isinstance(items, list) else []
            records = [item for item in listed if isinstance(item, dict)]
        return DecodedAnswer(fetched_at, params, status, records)

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
        for column, schema in zip(self.columns, self._schemas, strict=True):
            values = self.values(column.name, records)
            array, bad = coerce(values, column.parsed, schema, clean=True)  # `decoded` saw to it
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
