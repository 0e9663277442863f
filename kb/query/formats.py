"""Results for a terminal, a pipe or a file: aligned columns, DuckDB's box, CSV, JSON, Parquet.
Times are UTC: 2026-11-20T12:00:00Z.

CSV and JSON hold the data exactly. Tables are for people: numbers in full, long texts cut, and
control characters escaped.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import shutil
import sys
from collections.abc import Iterable, Iterator
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import IO, Any

import orjson
import pyarrow as pa
from pyarrow import types
from rich.cells import cell_len, set_cell_size

from kb.core import terminal
from kb.core.errors import UsageError
from kb.core.installation import pc
from kb.query.statements import distinct
from kb.store.atomic import writing
from kb.store.tables import database, parquet

_TABLE_ROWS = 100  # rows that a table shows
_CELL = 60  # columns of a terminal that a text may take
_LONGEST = 40  # digits of a number that is written without an exponent


def as_table(answer: pa.RecordBatchReader) -> Iterator[str]:
    """Aligned columns of the first hundred rows, with long texts cut, and the number of rows."""
    head = [terminal.one_line(name) for name in answer.schema.names]
    shown, total = [], 0
    for row in rows(answer):
        total += 1
        if total <= _TABLE_ROWS:
            shown.append([_cell(value) for value in row])
    right = [is_number(field.type) for field in answer.schema]
    widths = [max(map(cell_len, column)) for column in zip(head, *shown, strict=True)]
    for cells in (head, ["-" * width for width in widths], *shown):
        spaces = [" " * (width - cell_len(cell)) for cell, width in zip(cells, widths, strict=True)]
        aligned = (
            space + cell if is_right else cell + space
            for cell, space, is_right in zip(cells, spaces, right, strict=True)
        )
        yield "  ".join(aligned).rstrip() + "\n"
    if total > len(shown):
        yield _more(total)


def as_box(answer: pa.RecordBatchReader, width: int) -> Iterator[str]:
    """DuckDB's own box of the first hundred rows, and the number of rows.

    It is at most `width` columns wide, but never less than 80. DuckDB leaves out columns that
    don't fit, and counts them below the box.
    """
    stream = rows(answer)
    shown = list(itertools.islice(stream, _TABLE_ROWS))
    total = len(shown) + sum(1 for _ in stream)
    names = distinct([terminal.one_line(name) for name in answer.schema.names])
    arrays = [
        _box_column([row[number] for row in shown], field.type)
        for number, field in enumerate(answer.schema)
    ]
    table = pa.table(arrays, names=names)
    printed = io.StringIO()
    with database.connect() as con, contextlib.redirect_stdout(printed):
        # Without max_rows DuckDB leaves out the middle of more than twenty rows.
        con.from_arrow(table).show(max_width=width, max_rows=_TABLE_ROWS)
    yield printed.getvalue().rstrip() + "\n"
    if total > len(shown):
        yield _more(total)


def _box_column(values: list[Any], kind: pa.DataType) -> pa.Array[Any]:
    """Numbers and booleans as they are, so that they are aligned right; all else as text."""
    if types.is_float32(kind):
        return pa.array(values, pa.float64())
    if is_number(kind) or types.is_boolean(kind):
        return pa.array(values, kind)
    return pa.array(
        [None if value is None else for_display(value) for value in values], pa.string()
    )


def _more(total: int) -> str:
    return f"... {total:,} rows in total; --format csv prints all of them\n"


def as_csv(answer: pa.RecordBatchReader, limit: int | None = None) -> Iterator[str]:
    """The header, then one row at a time; lists and structs as JSON.

    With `limit`, a value of more characters is cut, with a note.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    for row in itertools.chain([answer.schema.names], rows(answer)):
        writer.writerow(_plain(value) if limit is None else _cut(value, limit) for value in row)
        yield buffer.getvalue()
        buffer.seek(0)
        buffer.truncate()


def _cut(value: Any, limit: int) -> Any:
    shown = _plain(value)
    if not isinstance(shown, str) or len(shown) <= limit:
        return shown
    return f"{shown[:limit]}… (cut, {len(shown):,} characters in total)"


def as_json(answer: pa.RecordBatchReader) -> Iterator[str]:
    """One array of objects, on one line."""
    names = answer.schema.names
    before = "["
    for row in rows(answer):
        yield before + _dump(dict(zip(names, row, strict=True)))
        before = ","
    yield "[]\n" if before == "[" else "]\n"


def as_ndjson(answer: pa.RecordBatchReader) -> Iterator[str]:
    """One object per line."""
    names = answer.schema.names
    for row in rows(answer):
        yield _dump(dict(zip(names, row, strict=True))) + "\n"


def rows(answer: pa.RecordBatchReader) -> Iterator[tuple[Any, ...]]:
    """Rows of Python's values."""
    for batch in answer:
        columns = map(_values, batch.schema.names, batch.columns)
        yield from zip(*columns, strict=True)


def _values(name: str, column: pa.Array[Any]) -> list[Any]:
    """Python's values of a column. Raises UsageError for values that Python lacks (year 20000)."""
    kind = column.type
    if types.is_float32(kind):  # 0.12, not the digits that a longer float has of it
        digits = column.cast(pa.string()).to_pylist()
        return [None if text is None else float(text) for text in digits]
    try:
        if types.is_timestamp(kind) and kind.unit == "ns":  # finer than Python's
            pattern = "%Y-%m-%dT%H:%M:%SZ" if kind.tz else "%Y-%m-%dT%H:%M:%S"
            column = pc.strftime(column, pattern)
        return column.to_pylist()
    except (OverflowError, ValueError) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UsageError(
            f"values of column {name} can't be printed: {what}",
            hint=f"cast it to text: {name}::VARCHAR",
        ) from None


def is_number(kind: pa.DataType) -> bool:
    """Whether values of an Arrow type are aligned right."""
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    text = for_display(value)
    if isinstance(value, (int, float, Decimal)) or cell_len(text) <= _CELL:
        return text
    return set_cell_size(text, _CELL - 1).rstrip() + "…"


def for_display(value: Any) -> str:
    """A value on one line that is safe on a terminal; numbers in full."""
    if isinstance(value, (float, Decimal)):
        text = str(value)
        full = f"{Decimal(text):f}" if "e" in text.lower() else text
        return full if len(full) <= _LONGEST else text
    return terminal.one_line(" ".join(str(_plain(value)).split()))


def _dump(value: Any) -> str:
    return orjson.dumps(
        value, default=_as_number_or_text, option=orjson.OPT_UTC_Z | orjson.OPT_NON_STR_KEYS
    ).decode()


def _as_number_or_text(value: Any) -> Any:
    """Decimals (DuckDB's sums and literals with a point) as numbers; all else as text."""
    if isinstance(value, Decimal):
        return (
            orjson.Fragment(str(int(value))) if value == value.to_integral_value() else float(value)
        )
    return str(value)


def _plain(value: Any) -> Any:
    """Times and booleans as JSON writes them; lists and structs as JSON."""
    if isinstance(value, (dict, list)):
        return _dump(value)
    if isinstance(value, datetime):
        text = value.isoformat()
        return text.removesuffix("+00:00") + "Z" if text.endswith("+00:00") else text
    return str(value).lower() if isinstance(value, bool) else value


SUFFIXES = {
    ".csv": "csv",
    ".json": "json",
    ".ndjson": "ndjson",
    ".jsonl": "ndjson",
    ".parquet": "parquet",
    ".txt": "table",
}
_LINES = {"table": as_table, "csv": as_csv, "json": as_json, "ndjson": as_ndjson}


def choose(given: str | None, out: Path | None) -> str:
    """The given format, else that of the file's suffix, else a table.

    Raises UsageError if `out` can't be written, if no format is given and the suffix is unknown, or
    if Parquet would be written to a terminal.
    """
    if out is None:
        if given == "parquet" and sys.stdout.isatty():
            raise UsageError(
                "Parquet can't be written to a terminal", hint="add --out FILE, or redirect stdout"
            )
        return given or "table"
    if out.is_dir():
        raise UsageError(f"--out {out} is a folder", hint="name a file in it")
    if not out.resolve().parent.is_dir():
        raise UsageError(
            f"--out {out}: there is no folder {out.resolve().parent}",
            hint="create it, or check the name",
        )
    if given is None and out.suffix.lower() not in SUFFIXES and not _special(out):
        raise UsageError(
            f"--out {out}: unknown suffix",
            hint=f"use one of {' '.join(SUFFIXES)}, or give --format",
        )
    return given or SUFFIXES.get(out.suffix.lower(), "table")


def write_answer(answer: pa.RecordBatchReader, format: str, out: Path | None) -> None:
    """Write every row. A file is replaced atomically, and links are followed.

    A table on a terminal is DuckDB's box. Raises UsageError if Parquet can't hold a column.
    """
    if out is None:
        _to_stdout(answer, format)
    elif format == "parquet" and not _special(out):
        with _opened(out) as path:
            _parquet(answer, path)
    elif format == "parquet":
        with out.open("wb") as binary:
            _parquet(answer, binary)
    else:
        with _opened(out) as path, path.open("w", encoding="utf-8") as file:
            file.writelines(_LINES[format](answer))


def for_people(answer: pa.RecordBatchReader) -> Iterable[str]:
    """A table that suits stdout."""
    if sys.stdout.isatty():
        return as_box(answer, shutil.get_terminal_size().columns)
    return as_table(answer)


def _to_stdout(answer: pa.RecordBatchReader, format: str) -> None:
    if format == "parquet":
        _parquet(answer, sys.stdout.buffer)
        return
    lines = for_people(answer) if format == "table" else _LINES[format](answer)
    if sys.stdout.isatty():
        # Tables are escaped already; files and pipes get the exact data.
        shown = terminal.json if format in ("json", "ndjson") else terminal.lines
        lines = map(shown, lines)
    sys.stdout.writelines(lines)
    sys.stdout.flush()


def _parquet(answer: pa.RecordBatchReader, file: Path | IO[bytes]) -> None:
    try:
        with parquet.writing(file, answer.schema) as writer:
            for batch in answer:
                writer.write_batch(batch)
    except pa.ArrowNotImplementedError as error:
        raise UsageError(
            f"Parquet can't hold a column of the result: {error}",
            hint="cast it to text: NAME::VARCHAR",
        ) from None


def _special(out: Path) -> bool:
    """Whether it is a device or pipe, which is written in place."""
    return out.exists() and not out.is_file()


def _opened(out: Path) -> contextlib.AbstractContextManager[Path]:
    return contextlib.nullcontext(out) if _special(out) else writing(out.resolve())
