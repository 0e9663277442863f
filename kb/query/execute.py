"""Runs one query over the views, streams its rows, and turns DuckDB's errors into one line, with
the nearest names for an unknown table or column.
"""

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from kb.artifacts.table_catalog import SCHEMAS, View, empty, view_name
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.core.progress import Progress
from kb.core.sources import PUBLISHED, SOURCES, exported_by
from kb.query import statements
from kb.query.remote_duckdb import reading_views
from kb.query.views import find_views
from kb.schema.tables import tables
from kb.store.damage import unreadable
from kb.store.tables import checksums, parquet
from kb.store.tables.reading import broken

_TABLE = re.compile(r'Table with name "?([^"!]+?)"? does not exist')
_COLUMN = re.compile(r'Values list "[^"]*" does not have a column named "([^"]+)"')
_LISTS = "`kb query --tables` lists the views"


def unknown_name(
    con: duckdb.DuckDBPyConnection, sql: str, error: Exception, root: Path | None
) -> KbError | None:
    """The error for an unknown table or column; None for an error of another kind."""
    text = str(error)
    if missing := _TABLE.search(text):
        name = missing[1]  # without the schema that the query gives
        given = re.search(rf'"?\b(\w+)"?\s*\.\s*"?{re.escape(name)}\b', sql, re.IGNORECASE)
        if given and given[1].lower() in SCHEMAS:
            name = f"{given[1].lower()}.{name}"
        return _table(con, name, text.splitlines()[0], root)
    if missing := _COLUMN.search(text):
        columns = con.execute(
            "SELECT DISTINCT column_name FROM duckdb_columns() WHERE list_contains(?, table_name)",
            [sorted(set(re.findall(r"\w+", sql)))],
        )
        near = similar(missing[1], [name for (name,) in columns.fetchall()])
        return UsageError(f"{one_line(error)}.{did_you_mean(near)}", hint=_LISTS)
    return None


def similar(name: str, names: Iterable[str]) -> list[str]:
    """The most similar names, at most three; none much less similar than the first."""
    by_lower = {one.lower(): one for one in names}
    near = difflib.get_close_matches(name.lower(), by_lower, 3)
    ratios = [difflib.SequenceMatcher(None, one, name.lower()).ratio() for one in near]
    return [
        by_lower[one] for one, ratio in zip(near, ratios, strict=True) if ratio > ratios[0] - 0.1
    ]


def one_line(error: Exception) -> str:
    """DuckDB's message without the excerpt of the query, and with three suggestions at most."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if not lines:
        return type(error).__name__
    starts = ("Did you mean", "Candidate bindings", "Candidate functions", "Candidate Entries")
    guesses = [line for line in lines[1:] if line.startswith(starts) and "duckdb_" not in line]
    return " ".join([lines[0], *(", ".join(line.split(", ")[:3]) for line in guesses)])


def _table(con: duckdb.DuckDBPyConnection, name: str, message: str, root: Path | None) -> KbError:
    views = con.execute(
        "SELECT schema_name, view_name FROM duckdb_views() WHERE list_contains(?, schema_name)",
        [list(SCHEMAS)],
    ).fetchall()
    schema, _, short = name.rpartition(".")
    full = [f"{one}.{view}" for one, view in views]
    if schema:
        near = [one for one in full if one.endswith(f".{short}")] or similar(name, full)
    else:
        near = similar(name, {view for _, view in views})
    message = message.partition(" because ")[0].rstrip("!")
    if not views:
        return empty((root or Path("data")).absolute())
    return UsageError(
        f"{message}!{did_you_mean(near)}", hint=(not near and _made_by(short, schema)) or _LISTS
    )


def _made_by(short: str, schema: str) -> str:
    """The commands that make a declared table without files."""
    if schema == "restored":
        return "`kb reddit reconstruct` makes it"
    known = {view_name(one): one.source for one in tables().values() if one.source in PUBLISHED}
    if short not in known:
        return ""
    source = known[short]
    if short == "pairs_scores":
        return "`kb pairs score` makes it"
    if source not in SOURCES or schema == "release":
        return f"`{exported_by(source)}` makes it"
    return f"`kb {source} crawl`, then `kb {source} filter` make it"


def did_you_mean(near: Sequence[str]) -> str:
    """ " Did you mean a or b?", to follow a message; "" without names."""
    return f" Did you mean {' or '.join(near)}?" if near else ""


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
        _check(statements.views_read(sql, views), progress or Progress())
        with reading_views(views):
            relation = con.sql(sql)
            cast = statements.casts(relation, text=text)
            answer: Any = relation.query("answer", cast) if cast else relation
            reader = answer.to_arrow_reader(_BATCH)
    except (duckdb.CatalogException, duckdb.BinderException) as error:
        if unknown := unknown_name(con, sql, error, root):
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
        with reading_views(views):
            for batch in reader:
                yield batch.rename_columns(names)
    except (pa.ArrowException, OSError) as error:
        # Arrow turns DuckDB's errors into an OSError without errno.
        raise _problem(error, views) from None


def _problem(error: Exception, views: Sequence[View]) -> KbError:
    """The error for a query that DuckDB failed to run: a damaged file, or a wrong query."""
    line = one_line(error)
    files = [path for view in views for path in view.files]
    named = [path for path in files if str(path) in str(error)]
    # A wrong query's error has a kind ("Binder Error: …"); the Parquet reader's has none.
    about_files = line.startswith(("IO Error: ", "Invalid Error: ")) or not re.match(
        r"[A-Z][\w -]* Error: ", line
    )
    if (named or about_files) and (damage := broken(named or files)):
        return damage
    remote = list(dict.fromkeys(view.remote.folder for view in views if view.remote is not None))
    if remote and about_files:
        return unreadable(" or ".join(map(str, remote)), line, "publish it again")
    if line.startswith("Out of Memory Error: "):
        return FatalError(line, hint="ask for less at a time")
    if line.startswith("IO Error: "):
        return DamagedData(line)
    return UsageError(line, hint="`kb query --tables` lists the views")
