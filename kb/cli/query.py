"""`kb query`: SQL over the tables of a data root."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kb.cli.command import command, group

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.cli.options import Options

app = group("SQL over the tables of the data root, by DuckDB.")

_TABLE_ROWS = 100  # rows shown by --format table
_CELL = 60  # characters of a cell shown by --format table


class Format(StrEnum):
    """How results are printed."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


@command(
    app,
    raw=True,
    resumable=False,
    examples=[
        "kb query --tables",
        'kb query "SELECT title, view_count FROM youtube_videos ORDER BY view_count DESC LIMIT 5"',
        'kb query "SELECT stage, count(*) FROM clean.youtube_rejected GROUP BY stage" --format csv',
        'kb query "FROM release.reddit_posts" --format parquet --out posts.parquet',
    ],
)
def query(
    options: Options,
    sql: Annotated[str | None, typer.Argument(metavar="SQL", help="A query; views are named SOURCE_TABLE.")] = None,
    tables: Annotated[bool, typer.Option("--tables", help="List the views and what they hold.")] = False,
    format: Annotated[Format, typer.Option("--format", help="How results are printed; --json is --format json.")] = Format.table,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write there instead of to stdout.")] = None,
) -> None:
    """Run SQL over the data root's tables.

    Schemas clean and release hold one view a table (clean.reddit_posts, release.youtube_videos);
    the bare name is the clean one where it exists, else the released one.
    """
    from kb.core.errors import UsageError
    from kb.schema import views

    if tables == (sql is not None):
        raise UsageError("give a query, or --tables", hint='for example: kb query "FROM youtube_videos LIMIT 5"')
    if format == Format.parquet and out is None and sys.stdout.isatty():
        raise UsageError("Parquet is no text for a terminal", hint="add --out FILE, or redirect stdout")
    run = options.make_run()
    if options.json and format == Format.table:
        format = Format.json
    with contextlib.closing(views.connect(run.root)) as db:
        if tables:
            catalog = views.catalog(run.root)
            if not catalog:
                run.progress.say(f"no tables in {run.root} yet: run a crawl and its filter first, or `kb demo`")
            _write(_listing(catalog), format, out)
        else:
            _write(views.select(db, sql or ""), format, out)


def _listing(catalog: list[tuple[str, str, int, str]]) -> pa.RecordBatchReader:
    import pyarrow as pa

    names = ("schema", "view", "rows", "about")
    columns = list(zip(*catalog, strict=True)) or [[] for _ in names]
    types = (pa.string(), pa.string(), pa.int64(), pa.string())
    table = pa.table({name: pa.array(column, kind) for name, column, kind in zip(names, columns, types, strict=True)})
    return table.to_reader()


def _write(answer: pa.RecordBatchReader, format: Format, out: Path | None) -> None:
    if format == Format.parquet:
        _write_parquet(answer, out)
        return
    lines = {Format.table: as_table, Format.csv: _as_csv, Format.json: _as_json}[format](answer)
    if out is None:
        sys.stdout.writelines(lines)
        sys.stdout.flush()
        return
    from kb.store.atomic import writing

    with writing(out) as path, path.open("w", encoding="utf-8") as file:
        file.writelines(lines)


def _write_parquet(answer: pa.RecordBatchReader, out: Path | None) -> None:
    import pyarrow.parquet as pq

    if out is None:
        with pq.ParquetWriter(sys.stdout.buffer, answer.schema, compression="zstd") as writer:
            for batch in answer:
                writer.write_batch(batch)
        return
    from kb.store.atomic import writing

    with writing(out) as path, pq.ParquetWriter(path, answer.schema, compression="zstd") as writer:
        for batch in answer:
            writer.write_batch(batch)


def _rows(answer: pa.RecordBatchReader) -> Iterator[list[Any]]:
    for batch in answer:
        yield from zip(*(column.to_pylist() for column in batch.columns), strict=True)


def as_table(answer: pa.RecordBatchReader) -> Iterator[str]:
    """Aligned columns; long values are cut and rows beyond a hundred counted, and it says so."""
    head = answer.schema.names
    shown, total = [], 0
    for row in _rows(answer):
        total += 1
        if total <= _TABLE_ROWS:
            shown.append([_cell(value) for value in row])
    numeric = [_is_number(field.type) for field in answer.schema]
    widths = [max(len(name), *(len(row[i]) for row in shown)) if shown else len(name) for i, name in enumerate(head)]
    for cells in (head, ["-" * width for width in widths], *shown):
        yield (
            "  ".join(cell.rjust(width) if right else cell.ljust(width) for cell, width, right in zip(cells, widths, numeric, strict=True)).rstrip()
            + "\n"
        )
    if total > len(shown):
        yield f"... {total:,} rows in all; --format csv prints every one\n"


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


def _as_csv(answer: pa.RecordBatchReader) -> Iterator[str]:
    import csv
    import io

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(answer.schema.names)
    for row in _rows(answer):
        writer.writerow([_dump(value) if isinstance(value, (dict, list)) else _plain(value) for value in row])
        if buffer.tell() > 1 << 16:
            yield buffer.getvalue()
            buffer.seek(0)
            buffer.truncate()
    yield buffer.getvalue()


def _as_json(answer: pa.RecordBatchReader) -> Iterator[str]:
    """One array of objects, in one line."""
    names = answer.schema.names
    before = "["
    for row in _rows(answer):
        yield before + _dump(dict(zip(names, row, strict=True)))
        before = ","
    yield "[]\n" if before == "[" else "]\n"


def _dump(value: Any) -> str:
    import orjson

    return orjson.dumps(value, default=_as_number_or_text, option=orjson.OPT_UTC_Z | orjson.OPT_NON_STR_KEYS).decode()


def _as_number_or_text(value: Any) -> Any:
    """Sums of integers and literals with a point are decimals in DuckDB."""
    from decimal import Decimal

    if isinstance(value, Decimal):
        return int(value) if value == value.to_integral_value() else float(value)
    return str(value)


def _plain(value: Any) -> Any:
    """Times as in the data, 2026-11-20T12:00:00Z."""
    from datetime import datetime

    if isinstance(value, datetime):
        text = value.isoformat()
        return text.removesuffix("+00:00") + "Z" if text.endswith("+00:00") else text
    return value
