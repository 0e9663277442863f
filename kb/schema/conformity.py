"""In what a stored table differs from its declaration: its columns by the schema of a file, its
numbers and times by their values.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from datetime import date
from typing import Any, TypeAlias

import pyarrow as pa

from kb.core.installation import pc
from kb.schema.tables import Column, Table, Type

Values: TypeAlias = "pa.Array[Any] | pa.ChunkedArray[Any]"
# Times that Python can hold, in microseconds and days since 1970; one beyond them fails wherever
# rows become objects.
_DATES = ((date.min - date(1970, 1, 1)).days, (date.max - date(1970, 1, 1)).days)
_TIMES = (_DATES[0] * 86_400_000_000, (_DATES[1] + 1) * 86_400_000_000 - 1)
_YEARS = "a time that is of no year from 1 to 9999"


def column_problems(
    declared: Table, stored: pa.Schema, *, released: bool
) -> Iterator[tuple[str, str]]:
    """(column, what is wrong): declared columns that are missing, there twice, or of another type.
    Case does not tell names apart, as in DuckDB.
    """
    counts = Counter(name.lower() for name in stored.names)
    for field in declared.arrow(released):
        if counts[field.name.lower()] > 1:
            yield field.name, f"column {field.name} is there twice"
        elif field.name not in stored.names:
            yield field.name, f"column {field.name} is missing"
        elif _plain(stored.field(field.name).type) != _plain(field.type):
            stored_type = stored.field(field.name).type
            yield field.name, f"column {field.name} is {stored_type}, not {field.type}"


def value_problem(column: Column, values: Values) -> str:
    """What is wrong with the first number of a column that is outside its declared range, or the
    first time that is of no year from 1 to 9999; "" where there is none.
    """
    wrong = _outside(column.parsed, values, column.range)
    return f"column {column.name} holds {wrong}" if wrong else ""


def limited(column: Column) -> bool:
    """Whether `value_problem` looks at the values of a column at all."""
    return bool(column.range) or _has_times(column.parsed)


def _outside(kind: Type, values: Any, allowed: tuple[float, float] | None) -> str:
    if kind.item is not None:
        return _outside(kind.item, pc.list_flatten(values), allowed)
    for index, (_, inner) in enumerate(kind.fields):
        if wrong := _outside(inner, pc.struct_field(values, [index]), allowed):
            return wrong
    if kind.text == "date":
        return _YEARS if _beyond(values.cast(pa.int32()), _DATES) else ""
    if kind.text.startswith("timestamp"):
        return _YEARS if _beyond(values.cast(pa.int64()), _TIMES) else ""
    if kind.text in ("string", "bool") or kind.fields or allowed is None:
        return ""
    low, high = (int(bound) if bound.is_integer() else bound for bound in allowed)
    first = _beyond(values, (low, high))
    return f"{first[0]:,}, which is not from {low:,} to {high:,}" if first else ""


def _beyond(values: Any, allowed: tuple[float, float]) -> list[Any]:
    """The first value that is not within these bounds, if any. NaN is neither above nor below
    anything, so what is allowed is looked for.
    """
    fits = pc.and_(pc.greater_equal(values, allowed[0]), pc.less_equal(values, allowed[1]))
    if pc.all(fits).as_py() is not False:
        return []
    return [values.filter(pc.invert(fits))[0].as_py()]


def _has_times(kind: Type) -> bool:
    if kind.item is not None:
        return _has_times(kind.item)
    inner = any(_has_times(field) for _, field in kind.fields)
    return inner or kind.text == "date" or kind.text.startswith("timestamp")


def _plain(kind: pa.DataType) -> pa.DataType:
    return kind.value_type if isinstance(kind, pa.DictionaryType) else kind
