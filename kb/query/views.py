"""DuckDB over a data root or a download: a schema per kind of table, a view per table.

`clean.youtube_videos`, `release.reddit_posts`, `restored.reddit_comments`, `links.entities`, as
kb.artifacts.table_catalog finds them. A bare name is the clean view if there is one, else the
released, the restored, or the links' one. Only files of these tables can be read: nothing can be
written, attached, loaded or fetched.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import duckdb

from kb.artifacts import manifest
from kb.artifacts.release_folder import read_tombstones
from kb.artifacts.table_catalog import SCHEMAS, Catalog, View, bare
from kb.query.limits import Limits
from kb.query.remote_reading import reading_views
from kb.store.damage import opening
from kb.store.state.tombstones import PERSON
from kb.store.tables import database, parquet
from kb.store.tables.reading import escaped, library_paths, reading, scan, sql_of, text_literal
from kb.store.tables.remote_files import reading_at


class ViewInfo(NamedTuple):
    """A line of `kb query --tables`."""

    schema: str
    view: str
    rows: int
    columns: int
    about: str


def find_views(root: Path) -> Sequence[View]:
    """Every table of a data root or a download, in a fixed order."""
    return Catalog(root.absolute()).views


def connect(
    root: Path | None, views: Sequence[View] | None = None, limits: Limits | None = None
) -> duckdb.DuckDBPyConnection:
    """An in-memory DuckDB with the data root's views, which can reach nothing else.

    `views`: these (with absolute paths) instead of those of `root`. Without a `root`, and for a
    download, nothing is spilled to the folder. `limits`: of memory and spilling; the time limit is
    up to `kb.query.limits.limited`. Raises DamagedData for a file that is not Parquet, or that a
    table of `root` lacks.
    """
    tables = Catalog(root.absolute()) if root else None
    con = _open(tables.spill if tables else None, limits)
    if tables:
        tables.require_tables()
    if views is None:
        views = tables.views if tables else []
    files = _make(con, views)
    # DuckDB checks the pattern, then the file.
    allowed = sorted(files | {escaped(file) for file in files})
    con.execute(f"SET allowed_paths = [{', '.join(map(text_literal, allowed))}]")
    con.execute("SET python_enable_replacements = false")  # Python's variables are not tables
    con.execute("SET enable_external_access = false")
    con.execute("SET lock_configuration = true")
    return con


def _open(root: Path | None, limits: Limits | None) -> duckdb.DuckDBPyConnection:
    if limits is None:
        return database.connect(root)
    con = database.connect(root, threads=limits.threads, memory=f"{limits.memory}B")
    if limits.spill:
        con.execute(f"SET max_temp_directory_size = '{limits.spill}B'")
    else:
        con.execute("SET temp_directory = ''")
    return con


def _make(con: duckdb.DuckDBPyConnection, views: Sequence[View]) -> set[str]:
    """Create the views; bare names in the default schema, so that SHOW TABLES lists each once. The
    paths and addresses that they read.
    """
    for schema in SCHEMAS:
        con.execute(f"CREATE SCHEMA {schema}")
    paths = _make_remote(con, [view for view in views if view.remote is not None])
    for view in views:
        if view.remote is not None:
            continue
        manifest.check_folder(view.files[0].parent)
        if view.files[0].suffix == ".ndjson":
            read_tombstones(view.files[0])  # DuckDB would take null for what is missing
        mine = library_paths(view.files, values=False)  # `select` looks at rows that it reads
        paths.update(mine)
        read = sql_of(mine, view.files[0].suffix == ".ndjson")
        with opening(view.files[0].parent, duckdb.Error), reading(view.files):
            # Tombstones of people are for this data root's own commands.
            shown = f" WHERE NOT starts_with(key, '{PERSON}')" if view.lists_tombstones else ""
            con.execute(f"CREATE VIEW {view.full} AS FROM {read}{shown}")
    for name, view in bare(views).items():
        con.execute(f"CREATE VIEW main.{name} AS FROM {view.full}")
    return paths


def _make_remote(con: duckdb.DuckDBPyConnection, views: Sequence[View]) -> set[str]:
    """Create the views of tables at addresses, which few commands read. The addresses."""
    if not views:
        return set()
    from kb.query.remote_duckdb import RemoteFiles  # noqa: PLC0415  fsspec takes 0.05 s to import

    system = RemoteFiles()
    con.register_filesystem(system)
    for view in views:
        if view.remote is not None:
            files = [system.add_file(view.remote.folder, name) for name in view.remote.names]
            with reading_views([view]):
                con.execute(f"CREATE VIEW {view.full} AS FROM {scan(files)}")
    return system.addresses


def catalog(views: Iterable[View]) -> list[ViewInfo]:
    """A line for every view, by schema and name. Raises DamagedData."""
    listing = []
    for view in views:
        if view.remote is not None:
            with reading_at(view.remote.folder.address):
                dataset = view.remote.dataset
                rows, columns = dataset.count_rows(), len(dataset.schema)
        elif view.lists_tombstones:
            table = read_tombstones(view.files[0])
            rows, columns = table.num_rows, table.num_columns
        else:
            with reading(view.files):
                footers = [parquet.footer(path) for path in view.files]
            columns = len(footers[0].schema.to_arrow_schema())
            rows = sum(footer.num_rows for footer in footers)
        listing.append(ViewInfo(view.schema, view.name, rows, columns, view.doc))
    return sorted(listing)
