"""Runs one query over the views, streams its rows, and turns DuckDB's errors into one line, with
the nearest names for an unknown table or column.
"""

import contextlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import duckdb
import msgspec
import pyarrow as pa

from kb.artifacts.table_catalog import SCHEMAS, View, empty, view_name
from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.core.progress import Progress
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.suggestions import did_you_mean, similar
from kb.query import statements
from kb.query.formats import as_csv
from kb.query.limits import Limits, limited, restrict_process, timed_out
from kb.query.remote_reading import reading_views
from kb.query.views import connect, find_views
from kb.schema.tables import tables
from kb.store.artifact_registry import ARTIFACTS
from kb.store.damage import unreadable
from kb.store.tables import checksums, database
from kb.store.tables.reading import broken

_TABLE = re.compile(r'Table with name "?([^"!]+?)"? does not exist')
_COLUMN = re.compile(r'Values list "[^"]*" does not have a column named "([^"]+)"')
_LISTS = "`kb query --tables` lists the views"
_START = 20.0  # seconds that the process may need besides its query
_KINDS: dict[str, type[KbError]] = {
    kind.__name__: kind for kind in (UsageError, FatalError, DamagedData)
}
# The package may be imported from a folder that only this process knows.
_CODE = "import sys; sys.path.append(sys.argv[1]); from kb.query.execute import main; main()"


def unknown_name(
    con: duckdb.DuckDBPyConnection,
    sql: str,
    error: Exception,
    root: Path | None,
    views: Sequence[View],
) -> KbError | None:
    """The error for an unknown table or column; None for an error of another kind."""
    text = str(error)
    if missing := _TABLE.search(text):
        name = missing[1]  # without the schema that the query gives
        given = re.search(rf'"?\b(\w+)"?\s*\.\s*"?{re.escape(name)}\b', sql, re.IGNORECASE)
        if given and given[1].lower() in SCHEMAS:
            name = f"{given[1].lower()}.{name}"
        return _table(views, name, text.splitlines()[0], root)
    if missing := _COLUMN.search(text):
        columns = con.execute(
            "SELECT DISTINCT column_name FROM duckdb_columns() WHERE list_contains(?, table_name)",
            [sorted(set(re.findall(r"\w+", sql)))],
        )
        near = similar(missing[1], [name for (name,) in columns.fetchall()])
        return UsageError(f"{database.one_line(error)}.{did_you_mean(near)}", hint=_LISTS)
    return None


def _table(views: Sequence[View], name: str, message: str, root: Path | None) -> KbError:
    schema, _, short = name.rpartition(".")
    full = [view.full for view in views]
    if schema:
        near = [view for view in full if view.endswith(f".{short}")] or similar(name, full)
    else:
        near = similar(name, {view.name for view in views})
    message = message.partition(" because ")[0].rstrip("!")
    if not views:
        return empty((root or Path("data")).absolute())
    return UsageError(
        f"{message}!{did_you_mean(near)}", hint=(not near and _made_by(short, schema)) or _LISTS
    )


def _made_by(short: str, schema: str) -> str:
    """The commands that make a declared table without files."""
    if schema == "restored":
        return "`kb restore` makes it"
    declared = (table for table in tables().values() if table.source in PUBLISHED)
    known = {view_name(table): table.source for table in declared}
    if short not in known:
        return ""
    source = known[short]
    if short == "pairs_scores":
        return "`kb pairs score` makes it"
    if source not in SOURCES or schema == "release":
        return f"`{ARTIFACTS[f'release/{source}'].command}` makes it"
    return f"`kb {source} crawl`, then `kb {source} filter` make it"


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
        statements.require_query(con, sql)
        _check(statements.views_read(sql, views), progress or Progress())
        with reading_views(views):
            relation = con.sql(sql)
            cast = statements.casts(relation, text=text)
            answer: Any = relation.query("answer", cast) if cast else relation
            reader = answer.to_arrow_reader(_BATCH)
    except (duckdb.CatalogException, duckdb.BinderException) as error:
        if unknown := unknown_name(con, sql, error, root, views):
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
        for view in views:
            view.verify_files()
        return
    with progress.task("check the tables (once)", total=size, unit="bytes") as task:
        for view in views:
            view.verify_files(task.advance)


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
    line = database.one_line(error)
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


class IsolatedQuery(msgspec.Struct):
    """What the process reads on stdin."""

    sql: str
    views: list[tuple[str, str, list[Path]]]  # schema, name, files
    rows: int
    characters: int
    cell: int
    seconds: float
    memory: int
    parent: int


class QueryReply(msgspec.Struct):
    """What the process writes: lines of CSV, the header first, and whether there are more; or an
    error (`kind` is its class).
    """

    lines: list[str] = []
    more: bool = False
    error: str = ""
    hint: str = ""
    kind: str = ""


def run_isolated(
    sql: str, views: Sequence[View], *, rows: int, characters: int, cell: int, limits: Limits
) -> QueryReply:
    """At most `rows` rows of a query over these views (with absolute paths), as lines of CSV.

    The lines have at most `characters` characters together, and a value at most `cell`. Raises
    UsageError, DamagedData or FatalError as `select` does, and FatalError for a query that exceeds
    its limits.
    """
    query = IsolatedQuery(
        sql,
        [(view.schema, view.name, view.files) for view in views],
        rows,
        characters,
        cell,
        limits.seconds,
        limits.memory,
        os.getpid(),
    )
    home = str(Path(__file__).resolve().parents[2])
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _CODE, home],
            input=msgspec.json.encode(query, enc_hook=str),
            capture_output=True,
            timeout=limits.seconds + _START,
            env={"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8"},
            cwd="/",
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise timed_out(limits.seconds) from None
    if done.returncode == 1 and b"longer than" in done.stderr:
        raise timed_out(limits.seconds)
    try:
        reply = msgspec.json.decode(done.stdout, type=QueryReply)
    except msgspec.DecodeError:
        raise FatalError(
            f"the query's process ended with exit code {done.returncode}: it exceeded its memory"
            " or other limits",
            hint="ask for less at a time",
        ) from None
    if reply.kind:
        raise _KINDS.get(reply.kind, FatalError)(reply.error, hint=reply.hint)
    return reply


def main() -> None:
    """Read a query, run it, write the reply; the process ends here."""
    query = msgspec.json.decode(
        sys.stdin.buffer.read(), type=IsolatedQuery, dec_hook=lambda _, path: Path(path)
    )
    tempfile.tempdir = os.devnull  # nothing is spilled
    limits = Limits(query.seconds, query.memory, threads=2)
    restrict_process(limits, query.parent)
    sys.stdout.buffer.write(msgspec.json.encode(_reply(query, limits)))
    sys.stdout.buffer.flush()
    os._exit(0)  # without waiting for threads of an interrupted query


def _reply(query: IsolatedQuery, limits: Limits) -> QueryReply:
    try:
        views = [View(schema, name, files, "") for schema, name, files in query.views]
        with contextlib.closing(connect(None, views, limits)) as con, limited(con, limits):
            reader = select(con, query.sql, views=views, text=True)
            lines = as_csv(reader, query.cell)
            return QueryReply(*_first(lines, query.rows + 1, query.characters))
    except KbError as error:
        kind = next(own.__name__ for own in type(error).__mro__ if own.__module__.startswith("kb."))
        return QueryReply(error=str(error), hint=error.hint, kind=kind)
    except MemoryError:
        return QueryReply(error="the query needs too much memory", kind=FatalError.__name__)


def _first(lines: Iterator[str], count: int, characters: int) -> tuple[list[str], bool]:
    """The first lines, and whether there are more."""
    taken: list[str] = []
    room = characters
    for line in lines:
        if len(taken) == count or len(line) > room:
            return taken, True
        taken.append(line)
        room -= len(line)
    return taken, False
