"""`kb query`: SQL over the tables of a data root."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import IO, TYPE_CHECKING, Annotated

import typer

from kb.cli.answer import as_csv, as_json, as_table
from kb.cli.command import command, group

if TYPE_CHECKING:
    import pyarrow as pa

    from kb.cli.options import Options

app = group("SQL over the tables of the data root, by DuckDB.")


class Format(StrEnum):
    """How results are printed."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"


@command(
    app,
    raw=True,
    uses=("limit",),
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
    sql: Annotated[
        str | None, typer.Argument(metavar="SQL", help="A query; views are named SOURCE_TABLE.")
    ] = None,
    tables: Annotated[
        bool, typer.Option("--tables", help="List the views and what they hold.")
    ] = False,
    format: Annotated[
        Format, typer.Option("--format", help="How results are printed; --json is --format json.")
    ] = Format.table,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Write there instead of to stdout.")
    ] = None,
) -> None:
    """Run SQL over the data root's tables.

    Schemas clean and release hold one view a table (clean.reddit_posts, release.youtube_videos);
    the bare name is the clean one where it exists, else the released one. --limit N gives the
    first N rows, with exit code 0.
    """
    from kb.core.errors import UsageError
    from kb.schema import views

    if tables == (sql is not None):
        raise UsageError(
            "give a query, or --tables", hint='for example: kb query "FROM youtube_videos LIMIT 5"'
        )
    if format == Format.parquet and out is None and sys.stdout.isatty():
        raise UsageError(
            "Parquet is no text for a terminal", hint="add --out FILE, or redirect stdout"
        )
    if out is not None and out.is_dir():
        raise UsageError(f"--out {out} is a folder", hint="name a file in it")
    run = options.make_run(needs="root")
    if options.json and format == Format.table:
        format = Format.json
    with contextlib.closing(views.connect(run.root)) as db:
        if tables:
            catalog = views.catalog(run.root)
            if not catalog:
                run.progress.say(
                    f"no tables in {run.root} yet: run a crawl and its filter first, or `kb demo`"
                )
            answer = _listing(catalog)
        else:
            answer = views.select(db, sql or "", root=run.root, text=format != Format.parquet)
        _write(_first(answer, options.limit) if options.limit else answer, format, out)


def _listing(catalog: list[tuple[str, str, int, str]]) -> pa.RecordBatchReader:
    import pyarrow as pa

    names = ("schema", "view", "rows", "about")
    columns = list(zip(*catalog, strict=True)) or [[] for _ in names]
    types = (pa.string(), pa.string(), pa.int64(), pa.string())
    table = pa.table(
        {
            name: pa.array(column, kind)
            for name, column, kind in zip(names, columns, types, strict=True)
        }
    )
    return table.to_reader()


def _first(answer: pa.RecordBatchReader, rows: int) -> pa.RecordBatchReader:
    import pyarrow as pa

    def batches() -> Iterator[pa.RecordBatch]:
        left = rows
        for batch in answer:
            yield batch.slice(0, left)
            left -= batch.num_rows
            if left <= 0:
                return

    return pa.RecordBatchReader.from_batches(answer.schema, batches())


def _write(answer: pa.RecordBatchReader, format: Format, out: Path | None) -> None:
    if format == Format.parquet:
        if out is None:
            _write_parquet(answer, sys.stdout.buffer)
        else:
            with _opened(out) as path, path.open("wb") as file:
                _write_parquet(answer, file)
        return
    lines = {Format.table: as_table, Format.csv: as_csv, Format.json: as_json}[format](answer)
    if out is None:
        sys.stdout.writelines(lines)
        sys.stdout.flush()
        return
    with _opened(out) as path, path.open("w", encoding="utf-8") as file:
        file.writelines(lines)


def _write_parquet(answer: pa.RecordBatchReader, file: IO[bytes]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from kb.core.errors import UsageError

    try:
        with pq.ParquetWriter(file, answer.schema, compression="zstd") as writer:
            for batch in answer:
                writer.write_batch(batch)
    except pa.ArrowNotImplementedError as error:
        raise UsageError(
            f"Parquet can't hold a column of this answer: {error}",
            hint="cast it to text: NAME::VARCHAR",
        ) from None


def _opened(out: Path) -> contextlib.AbstractContextManager[Path]:
    """Where to write: a device or pipe as it is, a file as a whole that takes its place (that of what a link points to)."""
    from kb.store.atomic import writing

    return (
        contextlib.nullcontext(out)
        if out.exists() and not out.is_file()
        else writing(out.resolve())
    )
