"""Rows of an answer as text: aligned columns, CSV, JSON. Times as in the data, 2026-11-20T12:00:00Z."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime, timedelta
from typing import TYPE_CHECKING, Any

from kb.core.errors import UsageError

if TYPE_CHECKING:
    import pyarrow as pa

_TABLE_ROWS = 100  # rows shown by --format table
_CELL = 60  # characters of a cell shown by --format table
_CYCLE = 146_097  # days of the 400 years after which the calendar repeats
_A_DAY = {"s": 86_400, "ms": 86_400 * 10**3, "us": 86_400 * 10**6, "ns": 86_400 * 10**9}


def as_table(answer: pa.RecordBatchReader) -> Iterator[str]:
    """Aligned columns; long values are cut and rows beyond a hundred counted, and it says so."""
    head = answer.schema.names
    shown, total = [], 0
    for row in _rows(answer):
        total += 1
        if total <= _TABLE_ROWS:
            shown.append([_cell(value) for value in row])
    numeric = [_is_number(field.type) for field in answer.schema]
    widths = [
        max(len(name), *(len(row[i]) for row in shown)) if shown else len(name)
        for i, name in enumerate(head)
    ]
    for cells in (head, ["-" * width for width in widths], *shown):
        yield (
            "  ".join(
                cell.rjust(width) if right else cell.ljust(width)
                for cell, width, right in zip(cells, widths, numeric, strict=True)
            ).rstrip()
            + "\n"
        )
    if total > len(shown):
        yield f"... {total:,} rows in all; --format csv prints every one\n"


def as_csv(answer: pa.RecordBatchReader) -> Iterator[str]:
    """A head line and a line a row; lists and structs as JSON."""
    import csv
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(answer.schema.names)
    for row in _rows(answer):
        writer.writerow(
            [_dump(value) if isinstance(value, (dict, list)) else _plain(value) for value in row]
        )
        if buffer.tell() > 1 << 16:
            yield buffer.getvalue()
            buffer.seek(0)
            buffer.truncate()
    yield buffer.getvalue()


def as_json(answer: pa.RecordBatchReader) -> Iterator[str]:
    """One array of objects, in one line."""
    names = answer.schema.names
    before = "["
    for row in _rows(answer):
        yield before + _dump(dict(zip(names, row, strict=True)))
        before = ","
    yield "[]\n" if before == "[" else "]\n"


def _rows(answer: pa.RecordBatchReader) -> Iterator[list[Any]]:
    for batch in answer:
        yield from zip(
            *(
                _values(name, column)
                for name, column in zip(batch.schema.names, batch.columns, strict=True)
            ),
            strict=True,
        )


def _values(name: str, column: pa.Array) -> list[Any]:
    """Python's values; times that Python has no value for (year 20000, infinity) make their column text."""
    import pyarrow as pa

    kind = column.type
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


def _is_number(kind: pa.DataType) -> bool:
    import pyarrow.types as types

    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    text = " ".join(_text(value).split())
    return text if len(text) <= _CELL else text[: _CELL - 1] + "…"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e6 else f"{value:.0f}"
    if isinstance(value, (dict, list)):
        return _dump(value)
    return str(_plain(value))


def _dump(value: Any) -> str:
    import orjson

    return orjson.dumps(
        value, default=_as_number_or_text, option=orjson.OPT_UTC_Z | orjson.OPT_NON_STR_KEYS
    ).decode()


def _as_number_or_text(value: Any) -> Any:
    """Sums of integers and literals with a point are decimals in DuckDB; JSON's integers have any number of digits."""
    from decimal import Decimal

    import orjson

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
