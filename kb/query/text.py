"""Rows of an answer as text: aligned columns, CSV, JSON. Times are UTC: 2026-11-20T12:00:00Z.

CSV and JSON hold the data exactly. The table is for people: numbers in full, long texts cut, and
what would act on a terminal written out.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator
from datetime import date, datetime, timedelta
from decimal import Decimal
from typing import Any

import orjson
import pyarrow as pa
from pyarrow import types
from rich.cells import cell_len, set_cell_size

from kb.core import terminal
from kb.core.errors import UsageError

TABLE_ROWS = 100  # rows that a table for people shows
_CELL = 60  # columns of a terminal that a text in it may take
_LONGEST = 40  # digits of a number that are written without an exponent
_CYCLE = 146_097  # days of the 400 years after which the calendar repeats
_A_DAY = {"s": 86_400, "ms": 86_400 * 10**3, "us": 86_400 * 10**6, "ns": 86_400 * 10**9}


def as_table(answer: pa.RecordBatchReader) -> Iterator[str]:
    """Aligned columns; long texts are cut and rows beyond a hundred counted, and it says so."""
    head = [terminal.one_line(name) for name in answer.schema.names]
    shown, total = [], 0
    for row in rows(answer):
        total += 1
        if total <= TABLE_ROWS:
            shown.append([_cell(value) for value in row])
    right = [is_number(field.type) for field in answer.schema]
    widths = [max(map(cell_len, column)) for column in zip(head, *shown, strict=True)]
    for cells in (head, ["-" * width for width in widths], *shown):
        yield "  ".join(map(_padded, cells, widths, right)).rstrip() + "\n"
    if total > len(shown):
        yield more(total)


def more(total: int) -> str:
    """The line under a table that does not show every row."""
    return f"... {total:,} rows in all; --format csv prints every one\n"


def as_csv(answer: pa.RecordBatchReader) -> Iterator[str]:
    """A head line and a line a row; lists and structs as JSON."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(answer.schema.names)
    for row in rows(answer):
        writer.writerow(
            [_dump(value) if isinstance(value, (dict, list)) else _plain(value) for value in row]
        )
        if buffer.tell() > 1 << 16:
            yield buffer.getvalue()
            buffer.seek(0)
            buffer.truncate()
    yield buffer.getvalue()


def csv_lines(answer: pa.RecordBatchReader, most: int) -> Iterator[str]:
    """The head line, then one row at a time; a value of more than `most` characters is cut, and
    says so.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    for row in itertools.chain([answer.schema.names], rows(answer)):
        writer.writerow([_at_most(value, most) for value in row])
        yield buffer.getvalue()
        buffer.seek(0)
        buffer.truncate()


def _at_most(value: Any, most: int) -> Any:
    shown = _dump(value) if isinstance(value, (dict, list)) else _plain(value)
    if not isinstance(shown, str) or len(shown) <= most:
        return shown
    return f"{shown[:most]}… (cut, {len(shown):,} characters in all)"


def as_json(answer: pa.RecordBatchReader) -> Iterator[str]:
    """One array of objects, in one line."""
    names = answer.schema.names
    before = "["
    for row in rows(answer):
        yield before + _dump(dict(zip(names, row, strict=True)))
        before = ","
    yield "[]\n" if before == "[" else "]\n"


def as_ndjson(answer: pa.RecordBatchReader) -> Iterator[str]:
    """An object a line."""
    names = answer.schema.names
    for row in rows(answer):
        yield _dump(dict(zip(names, row, strict=True))) + "\n"


def rows(answer: pa.RecordBatchReader) -> Iterator[list[Any]]:
    for batch in answer:
        yield from zip(
            *(
                values(name, column)
                for name, column in zip(batch.schema.names, batch.columns, strict=True)
            ),
            strict=True,
        )


def values(name: str, column: pa.Array[Any]) -> list[Any]:
    """Python's values; times that Python lacks (year 20000, infinity) make their column text."""
    kind = column.type
    if types.is_float32(kind):  # 0.12, not the digits that a longer float has of it
        digits = column.cast(pa.string()).to_pylist()
        return [None if text is None else float(text) for text in digits]
    if pa.types.is_timestamp(kind) and kind.unit == "ns":  # finer than Python's
        return [
            _moment(value, kind.unit, "Z" if kind.tz else "")
            for value in column.view(pa.int64()).to_pylist()
        ]
    try:
        return column.to_pylist()
    except (OverflowError, ValueError) as error:
        if pa.types.is_date32(kind):
            return [_day(value, 2**31 - 1) for value in column.view(pa.int32()).to_pylist()]
        if pa.types.is_timestamp(kind):
            return [
                _moment(value, kind.unit, "Z" if kind.tz else "")
                for value in column.view(pa.int64()).to_pylist()
            ]
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UsageError(
            f"column {name} holds what can't be printed: {what}",
            hint=f"cast it to text: {name}::VARCHAR",
        ) from None


def _day(days: int | None, infinite: int) -> str | None:
    """A date by its days since 1970, also outside of Python's years 1 to 9999."""
    if days is None:
        return None
    if abs(days) == infinite:
        return "infinity" if days > 0 else "-infinity"
    cycles, rest = divmod(days, _CYCLE)
    near = date(1970, 1, 1) + timedelta(days=rest)
    year = near.year + 400 * cycles
    return f"{'-' if year < 0 else ''}{abs(year):04d}-{near:%m-%d}"


def _moment(value: int | None, unit: str, zone: str) -> str | None:
    if value is None:
        return None
    if abs(value) == 2**63 - 1:
        return "infinity" if value > 0 else "-infinity"
    days, rest = divmod(value, _A_DAY[unit])
    seconds, part = divmod(rest, _A_DAY[unit] // 86_400)
    digits = {"s": 0, "ms": 3, "us": 6, "ns": 9}[unit]
    fraction = f".{part:0{digits}d}" if part else ""
    return f"{_day(days, -1)}T{timedelta(seconds=seconds)!s:0>8}{fraction}{zone}"


def is_number(kind: pa.DataType) -> bool:
    """Whether values of an Arrow type stand on the right of their column."""
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def _padded(cell: str, width: int, right: bool) -> str:
    space = " " * (width - cell_len(cell))
    return space + cell if right else cell + space


def _cell(value: Any) -> str:
    if value is None:
        return ""
    text = people(value)
    if isinstance(value, (int, float, Decimal)) or cell_len(text) <= _CELL:
        return text
    return set_cell_size(text, _CELL - 1).rstrip() + "…"


def people(value: Any) -> str:
    """A value in one line that is safe on a terminal; numbers in full."""
    if isinstance(value, (float, Decimal)):
        return _number(value)
    text = _dump(value) if isinstance(value, (dict, list)) else str(_plain(value))
    return terminal.one_line(" ".join(text.split()))


def _number(value: float | Decimal) -> str:
    text = str(value)
    if "e" not in text.lower():
        return text
    full = f"{Decimal(text):f}"
    return full if len(full) <= _LONGEST else text


def _dump(value: Any) -> str:
    return orjson.dumps(
        value, default=_as_number_or_text, option=orjson.OPT_UTC_Z | orjson.OPT_NON_STR_KEYS
    ).decode()


def _as_number_or_text(value: Any) -> Any:
    """Sums and literals with a point are decimals in DuckDB; JSON's integers have any length."""
    if isinstance(value, Decimal):
        return (
            orjson.Fragment(str(int(value))) if value == value.to_integral_value() else float(value)
        )
    return str(value)


def _plain(value: Any) -> Any:
    """Times and truth values as JSON writes them."""
    if isinstance(value, datetime):
        text = value.isoformat()
        return text.removesuffix("+00:00") + "Z" if text.endswith("+00:00") else text
    return str(value).lower() if isinstance(value, bool) else value
