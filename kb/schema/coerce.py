"""Values of raw answers → Arrow columns: whole columns at once, and no exception for a bad value.

Each function takes the values as JSON gave them (None where absent), or as Arrow read them from
JSON, and returns the column plus what could not be read: (row, value as text), null in the column.
The fast path asks Arrow for the whole column; only a column that holds something odd is gone
through value by value.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from types import NoneType
from typing import Any, TypeAlias

import pyarrow as pa
import pyarrow.json as pa_json

from kb.core import clock
from kb.core.installation import np, pc
from kb.schema.raw import types
from kb.schema.tables import Type

Bad = list[tuple[int, str]]
Values: TypeAlias = "Sequence[Any] | pa.Array[Any]"
UNHOLDABLE = re.compile("[\x00\ud800-\udfff]")
_DURATION = re.compile(
    r"P(?=.)(?:(\d+)W)?(?:(\d+)D)?(?:T(?=.)(?:(\d+)H)?(?:(\d+)M)?(?:(\d+)(?:\.\d+)?S)?)?"
)
_RFC3339 = re.compile(r"\d{4}-\d\d-\d\d[Tt]\d\d:\d\d:\d\d(\.\d+)?([Zz]|[+-]\d\d:\d\d)")
_SECONDS = (604_800, 86_400, 3_600, 60, 1)
_TIME = r"^(19[7-9]\d|2[01]\d\d)-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,6})?Z$"
_LARGEST = (1 << 63) - 1
_JSON: dict[str, pa.DataType] = {
    "string": pa.string(),
    "integer": pa.int64(),
    "boolean": pa.bool_(),
}


class WrongShape:
    """Stands for a field whose parent is not the object that it should be."""

    def __init__(self, value: Any) -> None:
        self.value = value


def coerce(
    values: Values, kind: Type, schema: dict[str, Any], *, clean: bool = False
) -> tuple[pa.Array[Any], Bad]:
    """The column of `values` as the declared type, read as the raw field's `schema` says.

    `clean` is the caller's word that no text holds a NUL.
    """
    if kind.item is not None:
        return records(values, kind) if kind.item.fields else lists(values, kind)
    if kind.text.startswith("timestamp"):
        seconds = types(schema) & {"integer", "number"}
        return unix_times(values) if seconds else times(values)
    if kind.text == "bool":
        return booleans(values, types(schema))
    if kind.text.startswith("int"):
        if schema.get("format") == "duration":
            return durations(values)
        return integers(values, types(schema), schema.get("minimum", -_LARGEST))
    if kind.text.startswith("float"):
        return _each(values, kind.arrow(), a_number)
    if "integer" in types(schema):
        return names(values)
    return texts(values, clean=clean)


_READ = {
    "string": {"string", "integer"},
    "bool": {"boolean", "string"},
    "int32": {"integer", "string"},
    "int64": {"integer", "string"},
    "float32": {"number", "integer"},
    "float64": {"number", "integer"},
    "timestamp[us, UTC]": {"string", "integer", "number"},
}


def unreadable(kind: Type, schema: dict[str, Any]) -> str:
    """Why `coerce` can't read such a column from such a field; "" where it can."""
    allowed = types(schema) - {"null"}
    read = _READ.get(kind.text, set())
    if kind.item is not None:
        read = {"object"} if kind.item.fields else {"array"} if kind.item.text == "string" else read
    if not read:
        return f"a {kind.text} is not read from JSON"
    if allowed <= read:
        return ""
    return f"a {kind.text} is not read from JSON's {', '.join(sorted(allowed - read))}"


def json_type(kind: Type, schema: dict[str, Any]) -> pa.DataType | None:
    """What Arrow reads the JSON of such a column as; None where it may be of several types."""
    if kind.item is not None and kind.item.fields:
        return pa.struct([(name, pa.list_(inner.arrow())) for name, inner in kind.item.fields])
    if kind.item is not None:
        return kind.arrow()
    allowed = types(schema) - {"null"}
    # The service writes numbers as strings where both are allowed.
    return _JSON["string"] if "string" in allowed else _JSON.get("".join(allowed))


def read_json(lines: Sequence[bytes], shape: pa.Schema) -> pa.Table | None:
    """A row of each JSON object, with the fields that `shape` has; None where a value is not of its
    type, or holds what Arrow can't.
    """
    # Most lines have no backslash, and one byte is found six times as fast.
    if any(b"\\" in line and b"\\u0000" in line for line in lines):
        return None
    text = pa.py_buffer(b"\n".join(lines))
    try:
        # Ten times as fast as decoding, and nothing is copied.
        bounds = pa.py_buffer(np.array([0, text.size]).tobytes())
        pa.LargeStringArray.from_buffers(1, bounds, text).validate(full=True)
        read = pa_json.read_json(
            pa.BufferReader(text),  # type: ignore[arg-type]
            pa_json.ReadOptions(use_threads=False, block_size=text.size + 1),
            pa_json.ParseOptions(explicit_schema=shape, unexpected_field_behavior="ignore"),
        )
    except (pa.ArrowInvalid, OverflowError):
        return None
    return read.combine_chunks() if len(read) == len(lines) else None


def texts(values: Values, *, clean: bool = False) -> tuple[pa.Array[Any], Bad]:
    """Strings. NUL and lone surrogates become U+FFFD."""
    try:
        column = _as_array(values, pa.string())
    except (pa.ArrowTypeError, pa.ArrowInvalid, UnicodeEncodeError):
        return _each(values, pa.string(), a_text)
    if not clean and pc.any(pc.match_substring(column, "\0")).as_py():
        return _each(values, pa.string(), a_text)
    return column, []


def names(values: Values) -> tuple[pa.Array[Any], Bad]:
    """Ids that the service writes as JSON integers, or as integers and strings."""
    if isinstance(values, pa.Array) and pa.types.is_int64(values.type):
        return values.cast(pa.string()), []
    return _each(values, pa.string(), _name)


def integers(values: Values, allowed: set[str], least: int = 0) -> tuple[pa.Array[Any], Bad]:
    """Decimal digits in a string, which are never negative, and, where the schema allows it, JSON
    integers that are not below `least`.
    """
    try:
        if "integer" in allowed and (
            pa.types.is_int64(values.type)
            if isinstance(values, pa.Array)
            else not set(map(type, values)) - {int, NoneType}
        ):
            integers = _as_array(values, pa.int64())
            smallest = pc.min(integers).as_py()
            if smallest is None or smallest >= least:
                return integers, []
        elif "string" in allowed:
            column = _as_array(values, pa.string())
            short = pc.less_equal(pc.binary_length(column), 18)
            if pc.all(pc.and_(pc.ascii_is_decimal(column), short)).as_py() is not False:
                return column.cast(pa.int64()), []
    except (pa.ArrowTypeError, pa.ArrowInvalid, UnicodeEncodeError, OverflowError):
        pass
    return _each(values, pa.int64(), partial(_count, allowed=allowed, least=least))


def durations(values: Values) -> tuple[pa.Array[Any], Bad]:
    """ISO 8601 durations → whole seconds: weeks, days, hours, minutes, seconds; P0D is 0."""
    return _each(values, pa.int64(), _duration)


def times(values: Values) -> tuple[pa.Array[Any], Bad]:
    """RFC 3339 times from 1970 to 2200 → UTC, with or without fractions of a second."""
    kind = pa.timestamp("us", "UTC")
    try:
        column = _as_array(values, pa.string())
        if pc.all(pc.fill_null(pc.match_substring_regex(column, _TIME), True)).as_py() is not False:
            return column.cast(kind), []
    except (pa.ArrowTypeError, pa.ArrowInvalid, UnicodeEncodeError):
        pass
    return _each(values, kind, _moment)


def unix_times(values: Values) -> tuple[pa.Array[Any], Bad]:
    """Seconds since 1970, up to 2200, whole or with a fraction → UTC."""
    return _each(
        values,
        pa.timestamp("us", "UTC"),
        _unix_moment,
    )


def booleans(values: Values, allowed: set[str]) -> tuple[pa.Array[Any], Bad]:
    """Booleans, or the strings "true" and "false" where the schema says string."""
    words = {"true": True, "false": False} if "string" in allowed else {}
    native = not allowed or "boolean" in allowed

    def boolean(value: Any) -> bool:
        return value if native and isinstance(value, bool) else words[value]

    return _each(values, pa.bool_(), boolean)


def lists(values: Values, kind: Type) -> tuple[pa.Array[Any], Bad]:
    """Lists of strings; an absent one is empty."""
    empty: list[str] = []
    if isinstance(values, pa.Array) and not pc.list_flatten(values).null_count:
        return pc.fill_null(values, pa.scalar(empty, kind.arrow())), []
    column, bad = _each(
        [empty if value is None else value for value in _objects(values)],
        kind.arrow(),
        lambda value: [a_text(item) for item in a_list(value)],
    )
    return pc.fill_null(column, pa.scalar(empty, kind.arrow())) if bad else column, bad


def records(values: Values, kind: Type) -> tuple[pa.Array[Any], Bad]:
    """Records whose fields are lists of their own ({"start_s": [0, 1], "text": ["a", "b"]}) as
    lists of structs, null where absent.

    Fields are numbers and texts; the last ones may be lists of numbers, which a record may leave
    out. A list of numbers that can't be read is empty, and its record stays. Those that `in_lists`
    made are such lists already.
    """
    if isinstance(values, pa.Array):
        return values, []
    return _each(values, kind.arrow(), partial(_rows, kind=kind))


def in_lists(values: pa.StructArray, kind: Type) -> pa.Array[Any] | None:
    """The same of records that Arrow read; None where something in them is odd."""
    assert kind.item is not None
    fields = kind.item.fields
    sizes = pc.list_value_length(values.field(fields[0][0]))
    columns: list[pa.Array[Any]] = []
    for name, inner in fields:
        lists = values.field(name)
        lengths = pc.list_value_length(lists)
        # Of lists of numbers a record may have none.
        if not (lengths if inner.item is None else pc.coalesce(lengths, sizes)).equals(sizes):
            return None
        cells = pc.list_flatten(lists)
        numbers = cells if inner.item is None else pc.list_flatten(cells)
        if numbers.null_count:
            return None
        if pa.types.is_floating(numbers.type):
            numbers = pc.add(numbers, 0.0)  # -0 is the same in whole numbers and in fractions
        if inner.item is not None:
            numbers = _with_absent(cells, numbers, lengths, sizes)
        columns.append(numbers)
    if sizes.null_count != values.null_count:
        return None
    ends = np.cumsum(pc.fill_null(sizes, 0).to_numpy())
    return pa.ListArray.from_arrays(
        pa.array(np.concatenate([[0], ends]), pa.int32()),
        pa.StructArray.from_arrays(columns, names=[name for name, _ in fields]),
        type=kind.arrow(),
        mask=pc.is_null(values),
    )


def _with_absent(
    cells: pa.Array[Any], numbers: pa.Array[Any], lengths: pa.Array[Any], sizes: pa.Array[Any]
) -> pa.Array[Any]:
    """`numbers` in lists as long as those of `cells`, `lengths` of them a row, and as many nulls as
    `sizes` says in a row whose length is null.
    """
    absent = np.repeat(pc.is_null(lengths).to_numpy(False), pc.fill_null(sizes, 0).to_numpy())
    inside, null = np.zeros(len(absent), np.int64), absent.copy()
    inside[~absent] = pc.fill_null(pc.list_value_length(cells), 0).to_numpy()
    null[~absent] = pc.is_null(cells).to_numpy(False)
    offsets = pa.array(np.concatenate([[0], np.cumsum(inside)]), pa.int32())
    return pa.ListArray.from_arrays(offsets, numbers, mask=pa.array(null))


def _rows(value: Any, kind: Type) -> list[dict[str, Any]]:
    """Records, cell by cell."""
    assert kind.item is not None
    if not isinstance(value, dict):
        raise TypeError
    made: dict[str, list[Any]] = {}
    for name, inner in kind.item.fields:
        if inner.item is not None and value.get(name) is None:
            made[name] = [None] * max(map(len, made.values()))
        else:
            made[name] = [_cell(cell, inner) for cell in a_list(value[name])]
    rows = zip(*made.values(), strict=True)
    return [dict(zip(made, cells, strict=True)) for cells in rows]


def _cell(value: Any, kind: Type) -> Any:
    if kind.item is None:
        return a_text(value) if kind.text == "string" else a_number(value)
    try:
        return None if value is None else [a_number(entry) for entry in a_list(value)]
    except (ValueError, TypeError, OverflowError):
        return []


def inner(value: Any, *names: str) -> Any:
    """What stands under these names in objects within objects, None where nothing does."""
    for name in names:
        value = value.get(name) if isinstance(value, dict) else None
    return value


def shown(value: Any) -> str:
    """A bad value as text for `rejected.value`; long ones are cut."""
    value = value.value if isinstance(value, WrongShape) else value
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=repr)
    text = UNHOLDABLE.sub("\ufffd", text)
    return text if len(text) <= 200 else text[:197] + "..."


def _as_array(values: Values, kind: pa.DataType) -> pa.Array[Any]:
    return values if isinstance(values, pa.Array) else pa.array(values, kind)


def _objects(values: Values) -> Sequence[Any]:
    return values.to_pylist() if isinstance(values, pa.Array) else values


def _each(
    values: Values, kind: pa.DataType, make: Callable[[Any], Any]
) -> tuple[pa.Array[Any], Bad]:
    bad: Bad = []
    made: list[Any] = []
    for row, value in enumerate(_objects(values)):
        try:
            made.append(None if value is None else make(value))
        except (ValueError, KeyError, TypeError, OverflowError, OSError):  # OSError: a far time
            made.append(None)
            bad.append((row, shown(value)))
    return pa.array(made, kind), bad


def a_text(value: Any) -> str:
    """A string as Arrow can hold it. Raises TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError
    return UNHOLDABLE.sub("\ufffd", value)


def a_number(value: Any) -> float:
    """A number as a float. Raises TypeError for anything else, OverflowError for a huge one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value) + 0.0  # no -0.0


def _name(value: Any) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    return a_text(value)


def _count(value: Any, allowed: set[str], least: int) -> int:
    if isinstance(value, str) and "string" in allowed:
        if not (value.isascii() and value.isdigit()):
            raise ValueError
        count = int(value)
    elif isinstance(value, bool) or not isinstance(value, int) or "integer" not in allowed:
        raise TypeError
    else:
        count = value
    if not least <= count <= _LARGEST:
        raise ValueError
    return count


def _duration(value: Any) -> int:
    match = _DURATION.fullmatch(value)
    if match is None or not value.isascii():
        raise ValueError(value)
    total = sum(
        int(number) * size for number, size in zip(match.groups(), _SECONDS, strict=True) if number
    )
    if total > _LARGEST:
        raise ValueError(value)
    return total


def _unix_moment(value: Any) -> datetime:
    at = clock.since_1970(a_number(value))
    if at is None:
        raise ValueError
    return at


def _moment(value: Any) -> datetime:
    if not isinstance(value, str) or not value.isascii() or not _RFC3339.fullmatch(value):
        raise ValueError
    at = clock.parse(value)
    if not clock.FIRST <= at <= clock.LAST:
        raise ValueError
    return at


def a_list(value: Any) -> list[Any]:
    """The list. Raises TypeError for anything else."""
    if not isinstance(value, list):
        raise TypeError
    return value
