"""Lists of fixed rows in JSON ([[start, duration, text], …]) → lists of structs.

Fields are numbers and texts; the last ones may be lists of numbers, which a row may leave out.

Parsing leaves such lists as the text that they are in the answer, so that a row which an older
answer or a stage takes out is never decoded, and one that stays is moved as one piece of bytes.
What is read here is decoded list by list into a type of its own: a list is small enough for the
processor's cache, all lists of a segment are not. Only a list that holds something odd is gone
through cell by cell.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import accumulate
from operator import attrgetter
from typing import Any

import msgspec
import pyarrow as pa

from kb.core.errors import DamagedData
from kb.schema.coerce import Bad, WrongShape, a_list, a_number, a_text, shown
from kb.schema.types import Type

_NUL = b"\\u0000"
AT_ONCE = 1_024  # rows, with their texts about as much as a processor's cache holds


def verbatim(value: Any) -> msgspec.Raw:
    """A decoded value as JSON text again, in ASCII: what no text may hold stands there escaped."""
    return msgspec.Raw(json.dumps(value.value if isinstance(value, WrongShape) else value).encode())


def texts(values: Sequence[msgspec.Raw]) -> pa.Array[Any]:
    """JSON texts as a column. Raises DamagedData where one is no JSON, as its bytes are no text."""
    joined = b"".join(values)
    sizes = (memoryview(value).nbytes for value in values)
    offsets = pa.py_buffer(array("i", accumulate(sizes, initial=0)))
    column = pa.StringArray.from_buffers(len(values), offsets, pa.py_buffer(joined))
    try:
        column.validate(full=True)
    except pa.ArrowInvalid:
        return pa.array([_as_text(bytes(value)) for value in values], pa.string())
    return column


def _as_text(value: bytes) -> str:
    try:
        return value.decode()
    except UnicodeDecodeError:
        return json.dumps(_loaded(value))


def records(column: pa.Array[Any], kind: Type) -> tuple[pa.Array[Any], Bad]:
    """The lists in a column of JSON texts, null where `null` stands, and what could not be read.

    `kind` is a list of structs of numbers, texts and lists of numbers. A list of numbers that can't
    be read is empty, and its row stays. Raises DamagedData for what is no JSON.
    """
    decode = _decoder(kind)
    made = _Columns(kind)
    sizes: list[int | None] = []
    bad: Bad = []
    for row, text in enumerate(_each(column)):
        try:
            if _NUL in text:
                raise msgspec.DecodeError
            rows = decode(text)
        except msgspec.DecodeError:
            rows, problems = _careful(text, kind)
            bad += [(row, value) for value in problems]
        sizes.append(None if rows is None else len(rows))
        if rows:
            made.add(rows)
    ends = list(accumulate((size or 0 for size in sizes), initial=0))
    absent = pa.array([size is None for size in sizes], pa.bool_()) if None in sizes else None
    offsets = pa.array(ends, pa.int32())
    return pa.ListArray.from_arrays(offsets, made.struct(), type=kind.arrow(), mask=absent), bad


class _Columns:
    """A column of each field, made of some rows at a time."""

    def __init__(self, kind: Type) -> None:
        assert kind.item is not None
        self._names = [name for name, _ in kind.item.fields]
        self._takes = list(map(attrgetter, self._names))
        self._types = [inner.arrow() for _, inner in kind.item.fields]
        self._parts: list[list[pa.Array[Any]]] = [[pa.array([], type_)] for type_ in self._types]
        self._waiting: list[Any] = []

    def add(self, rows: list[Any]) -> None:
        self._waiting += rows
        if len(self._waiting) >= AT_ONCE:
            self._flush()

    def struct(self) -> pa.Array[Any]:
        """All rows."""
        self._flush()
        columns = [pa.concat_arrays(parts) for parts in self._parts]
        return pa.StructArray.from_arrays(columns, names=self._names)

    def _flush(self) -> None:
        for parts, take, type_ in zip(self._parts, self._takes, self._types, strict=True):
            parts.append(pa.array(list(map(take, self._waiting)), type_))
        self._waiting.clear()


@cache
def _decoder(kind: Type) -> Callable[[bytes], Any]:
    made = _row(kind)
    decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(list[made] | None)  # type: ignore[valid-type]
    return decoder.decode


@cache
def _row(kind: Type) -> type[msgspec.Struct]:
    assert kind.item is not None
    fields: list[Any] = [
        (name, list[float] | None, None)
        if inner.item is not None
        else (name, str if inner.text == "string" else float)
        for name, inner in kind.item.fields
    ]
    return msgspec.defstruct("Row", fields, array_like=True, forbid_unknown_fields=True, gc=False)


def _careful(text: bytes, kind: Type) -> tuple[list[Any] | None, list[str]]:
    """The rows of an odd list; None, and what was found, for a bad one."""
    value = _loaded(text)
    if value is None:
        return None, []
    assert kind.item is not None
    makers: list[Callable[[Any], Any]] = [
        _numbers if inner.item is not None else a_text if inner.text == "string" else a_number
        for _, inner in kind.item.fields
    ]
    row, least = _row(kind), sum(make is not _numbers for make in makers)
    try:
        cells = [a_list(record) for record in a_list(value)]
        if not all(least <= len(record) <= len(makers) for record in cells):
            raise ValueError("a row of another length")
        return [
            row(*(make(cell) for make, cell in zip(makers, record, strict=False)))
            for record in cells
        ], []
    except (ValueError, TypeError, OverflowError):
        return None, [shown(value)]


def _numbers(value: Any) -> list[float] | None:
    """A list of numbers; an empty one for anything else."""
    try:
        return None if value is None else [a_number(cell) for cell in a_list(value)]
    except (ValueError, TypeError, OverflowError):
        return []


def _loaded(text: bytes) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise DamagedData(f"a raw line is not an envelope: {error!r}") from None


def _each(column: pa.Array[Any]) -> Iterator[bytes]:
    """The bytes of each text; `null` where there is none."""
    _, offsets, data = column.buffers()
    if offsets is None or not len(column):
        return
    ends = memoryview(offsets).cast("i")[column.offset : column.offset + len(column) + 1]
    content = memoryview(data if data is not None else b"")
    there = column.is_valid().to_pylist()
    for row, is_there in enumerate(there):
        yield bytes(content[ends[row] : ends[row + 1]]) if is_there else b"null"
