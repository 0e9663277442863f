"""Runs one query over the views, streams its rows, and turns DuckDB's errors into one line."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from kb.artifacts.table_catalog import View
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.core.progress import Progress, Silent
from kb.query import statements, suggestions
from kb.query.views import find_views
from kb.store.tables import checksums, parquet
from kb.store.tables.reading import broken

_BATCH = 10_000  # rows
_QUICK = 1 << 30  # bytes that are read in a moment


def select(
    con: duckdb.DuckDBPyConnection,
    sql: str,
    *,
    root: Path | None = None,
    views: Sequence[View] | None = None,
    text: bool = False,
    progress: Progress | None = None,
) -> pa.RecordBatchReader:
    """Run one query and stream its rows; columns of one name become a, a_1, a_2.

    The files of the views that it reads are compared with their checksums first, once per process;
    `progress` shows this if it takes longer than a moment.

    Columns that Arrow can't hold (intervals, bits) become text; with `text` bytes do too. Raises
    UsageError for a wrong query, with the nearest names, and for anything but a query; DamagedData
    for a file of `root` (or of `views`, as given to `connect`) that can't be read. Both may be
    raised while rows are read.
    """
    if views is None:
        views = list(find_views(root.absolute())) if root else []
    try:
        statements.check(con, sql)
        _check(statements.views_read(sql, views), progress or Silent())
        relation = con.sql(sql)
        cast = statements.casts(relation, text=text)
        answer: Any = relation.query("answer", cast) if cast else relation
        reader = answer.to_arrow_reader(_BATCH)
    except (duckdb.CatalogException, duckdb.BinderException) as error:
        if unknown := suggestions.unknown(con, sql, error, root):
            raise unknown from None
        raise _problem(error, views) from None
    except duckdb.Error as error:
        raise _problem(error, views) from None
    names = statements.distinct(reader.schema.names)
    fields = [field.with_name(name) for field, name in zip(reader.schema, names, strict=True)]
    return pa.RecordBatchReader.from_batches(pa.schema(fields), _batches(reader, names, views))


def _check(views: Sequence[View], progress: Progress) -> None:
    """Raise DamagedData for a checksum mismatch."""
    files = [path for view in views for path in view.files]
    size = checksums.unverified_size(files)
    if size < _QUICK:
        parquet.check(*files)
        return
    with progress.task("check the tables (once)", total=size, unit="bytes") as task:
        parquet.check(*files, advance=task.advance)


def _batches(
    reader: pa.RecordBatchReader, names: list[str], views: Sequence[View]
) -> Iterator[pa.RecordBatch]:
    try:
        for batch in reader:
            yield batch.rename_columns(names)
    except (pa.ArrowException, OSError) as error:
        # Arrow turns DuckDB's errors into an OSError without errno.
        raise _problem(error, views) from None


def _problem(error: Exception, views: Sequence[View]) -> KbError:
    """The error for a query that DuckDB failed to run: a damaged file, or a wrong query."""
    line = suggestions.one_line(error)
    files = [path for view in views for path in view.files]
    named = [path for path in files if str(path) in str(error)]
    # A wrong query's error has a kind ("Binder Error: …"); the Parquet reader's has none.
    about_files = line.startswith(("IO Error: ", "Invalid Error: ")) or not re.match(
        r"[A-Z][\w -]* Error: ", line
    )
    if (named or about_files) and (damage := broken(named or files)):
        return damage
    if line.startswith("Out of Memory Error: "):
        return FatalError(line, hint="ask for less at a time")
    if line.startswith("IO Error: "):
        return DamagedData(line)
    return UsageError(line, hint="`kb query --tables` lists the views")
