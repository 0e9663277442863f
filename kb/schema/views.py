"""DuckDB over a data root: schemas `clean` and `release` with one view a table.

`clean.youtube_videos`, `release.reddit_posts`, `clean.wiki_rejected`, `pairs`; a bare name is the
clean view where it exists, else the released one. Only files of the data root's tables can be
read, and only queries are run: nothing is written, attached, loaded or fetched.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kb.core.errors import DamagedData, FatalError, KbError, UsageError
from kb.schema import statements
from kb.schema.tables import Table, table, tables
from kb.store.reading import advice, broken, escaped, reading, scan

if TYPE_CHECKING:
    import duckdb
    import pyarrow as pa

SOURCES = ("youtube", "wiki", "reddit", "pairs")
_VERDICTS = ("rejected", "failed", "pending")


class View(NamedTuple):
    """A view that has files: `schema` is "clean" or "release"."""

    schema: str
    name: str
    files: list[Path]
    declared: Table


def found(root: Path) -> Iterator[View]:
    """Every view that the data root has files for, in a fixed order."""
    for declared in tables().values():
        if declared.source not in SOURCES:
            continue
        name = "pairs" if declared.name == "pairs/pairs" else f"{declared.source}_{declared.short}"
        clean = (
            root / "pairs"
            if declared.source == "pairs"
            else root / "clean" / declared.source / declared.short
        )
        yield from _view("clean", name, clean, "*.parquet", declared)
        released = root / "release" / declared.source
        yield from _view("release", name, released, f"{declared.short}-*-of-*.parquet", declared)
    for source in SOURCES:
        for verdict in _VERDICTS:
            place = root / "clean" / source / verdict
            yield from _view(
                "clean", f"{source}_{verdict}", place, "*.parquet", table(f"shared/{verdict}")
            )
        gone = table("shared/tombstones")
        yield from _view(
            "clean", f"{source}_tombstones", root / "raw" / source, "tombstones.parquet", gone
        )
        yield from _view(
            "release", f"{source}_tombstones", root / "release" / source, "tombstones.parquet", gone
        )


def _view(schema: str, name: str, folder: Path, pattern: str, declared: Table) -> Iterator[View]:
    files = (
        sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))
        if folder.is_dir()
        else []
    )
    if files:
        yield View(schema, name, files, declared)


def views(con: duckdb.DuckDBPyConnection, root: Path) -> list[View]:
    """Make the views in `con`. Raises DamagedData for a file that is no Parquet."""
    import duckdb

    made = list(found(root.absolute()))
    con.execute("CREATE SCHEMA IF NOT EXISTS clean")
    con.execute("CREATE SCHEMA IF NOT EXISTS release")
    for view in made:
        try:
            with reading(view.files):
                con.execute(
                    f"CREATE OR REPLACE VIEW {view.schema}.{view.name} AS SELECT * FROM {scan(view.files)}"
                )
        except duckdb.Error as error:
            raise DamagedData(
                f"{view.files[0].parent}: {one_line(error)}", hint=advice(view.files[0])
            ) from None
    return made


def connect(root: Path) -> duckdb.DuckDBPyConnection:
    """An in-memory DuckDB with the data root's views, which can reach nothing else."""
    import duckdb

    con = duckdb.connect()
    con.execute("SET TimeZone = 'UTC'")
    made = views(con, root)
    con.execute("SET search_path = 'clean,release'")
    folders = {f"{view.files[0].parent}/" for view in made}
    allowed = sorted(
        folders | {escaped(folder) for folder in folders}
    )  # the pattern is checked, then the file
    con.execute(f"SET allowed_directories = [{', '.join(_quoted(folder) for folder in allowed)}]")
    con.execute("SET enable_external_access = false")
    con.execute("SET lock_configuration = true")
    return con


def catalog(root: Path) -> list[tuple[str, str, int, str]]:
    """(schema, view, rows, description) of every view that has files. Raises DamagedData."""
    import pyarrow.parquet as pq

    listing = []
    for view in found(root):
        with reading(view.files):
            rows = sum(pq.read_metadata(path).num_rows for path in view.files)
        listing.append((view.schema, view.name, rows, view.declared.doc))
    return sorted(listing)


def select(
    con: duckdb.DuckDBPyConnection, sql: str, *, root: Path | None = None, text: bool = False
) -> pa.RecordBatchReader:
    """Runs one query over the views and streams its rows; columns of one name become a, a_1, a_2.

    What Arrow can't hold (intervals, bits) comes as text, with `text` bytes too. Raises UsageError in
    one line for what is wrong with it (with DuckDB's own guess, or the names there are), and for
    anything that is no query; DamagedData for a file of `root` that can't be read. Both may come
    while rows are read.
    """
    import duckdb
    import pyarrow as pa

    try:
        statements.check(con, sql)
        relation = con.sql(sql)
        cast = statements.casts(relation, text=text)
        reader = (relation.query("answer", cast) if cast else relation).to_arrow_reader(10_000)
    except duckdb.CatalogException as error:
        raise UsageError(one_line(error), hint=_names(con)) from None
    except duckdb.Error as error:
        raise _problem(error, root) from None
    names = statements.distinct(reader.schema.names)
    schema = pa.schema(
        [field.with_name(name) for field, name in zip(reader.schema, names, strict=True)]
    )
    return pa.RecordBatchReader.from_batches(schema, _batches(reader, names, root))


def _batches(
    reader: pa.RecordBatchReader, names: list[str], root: Path | None
) -> Iterator[pa.RecordBatch]:
    import pyarrow as pa

    try:
        for batch in reader:
            yield batch.rename_columns(names)
    except (
        pa.ArrowException,
        OSError,
    ) as error:  # what DuckDB raises becomes an OSError without a number on its way
        raise _problem(error, root) from None


def _problem(error: Exception, root: Path | None) -> KbError:
    """What to say of a query that DuckDB gave up: a file is damaged, or the query is wrong."""
    line = one_line(error)
    files = [path for view in found(root.absolute()) for path in view.files] if root else []
    named = [path for path in files if str(path) in str(error)]
    # A wrong query has a kind ("Binder Error: …"); what a reader of Parquet stumbles over has none.
    about_files = line.startswith(("IO Error: ", "Invalid Error: ")) or not re.match(
        r"[A-Z][\w -]* Error: ", line
    )
    if (named or about_files) and (damage := broken(named or files)):
        return damage
    if line.startswith("Out of Memory Error: "):
        return FatalError(line, hint="ask for less at a time")
    return (
        DamagedData(line)
        if line.startswith("IO Error: ")
        else UsageError(line, hint="`kb query --tables` lists the views")
    )


def one_line(error: Exception) -> str:
    """DuckDB's message without its drawing of the query; its guess at what was meant is kept."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    starts = ("Did you mean", "Candidate bindings", "Candidate functions")
    guess = [line for line in lines[1:] if line.startswith(starts) and "duckdb_" not in line]
    return " ".join([lines[0], *guess]) if lines else type(error).__name__


def _names(con: duckdb.DuckDBPyConnection) -> str:
    rows = con.execute(
        "SELECT schema_name || '.' || view_name FROM duckdb_views() WHERE schema_name IN ('clean', 'release') ORDER BY ALL"
    ).fetchall()
    names = ", ".join(row[0] for row in rows)
    return (
        f"there are: {names}"
        if names
        else "no tables yet: run a crawl and filter first, or make demo"
    )


def _quoted(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
