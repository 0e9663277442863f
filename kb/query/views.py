"""DuckDB over a data root or a download: a schema for each kind of table, one view a table.

`clean.youtube_videos`, `release.reddit_posts`, `restored.reddit_comments`, `links.entities`, as
kb.artifacts.catalog finds them; a bare name is the clean view where it exists, else the released,
else the restored one, else the links'. Only files of these tables can be read: nothing is written,
attached, loaded or fetched.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import duckdb
import pyarrow.parquet as pq

from kb.artifacts import manifest
from kb.artifacts.catalog import SCHEMAS, Catalog, View, bare
from kb.artifacts.release_folder import read_tombstones
from kb.core.errors import DamagedData
from kb.query.bounds import Limits
from kb.store import database
from kb.store.advice import advice
from kb.store.reading import escaped, reading, scan


class Listed(NamedTuple):
    """A line of `kb query --tables`."""

    schema: str
    view: str
    rows: int
    columns: int
    about: str


def found(root: Path) -> Sequence[View]:
    """Every table of a data root or a download, in a fixed order."""
    return Catalog(root.absolute()).views


def connect(
    root: Path | None, views: Sequence[View] | None = None, limits: Limits | None = None
) -> duckdb.DuckDBPyConnection:
    """An in-memory DuckDB with the data root's views, which can reach nothing else.

    `views`: these instead of what is found at `root`, with absolute paths; without a `root`, and in
    a download, nothing is spilled beside them. `limits`: of memory and what is spilled; time is
    `kb.query.bounds.bounded`'s. Raises DamagedData for a file that is no Parquet.
    """
    held = Catalog(root.absolute()) if root else None
    con = _open(held.path if held and not held.is_download else None, limits)
    if views is None:
        views = held.views if held else []
        if held:
            held.check()
    _make(con, views)
    files = {str(path) for view in views for path in view.files}
    # The pattern is checked, then the file.
    allowed = sorted(files | {escaped(file) for file in files})
    con.execute(f"SET allowed_paths = [{', '.join(map(_quoted, allowed))}]")
    con.execute("SET python_enable_replacements = false")  # no table is a variable of this program
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


def _make(con: duckdb.DuckDBPyConnection, views: Sequence[View]) -> None:
    """The views, and bare names in the default schema, so that SHOW TABLES has each once."""
    for schema in SCHEMAS:
        con.execute(f"CREATE SCHEMA {schema}")
    for view in views:
        try:
            manifest.check_folder(view.files[0].parent)
            with reading(view.files):
                con.execute(f"CREATE VIEW {view.full} AS FROM {scan(view.files)}")
        except duckdb.Error as error:
            raise DamagedData(
                f"{view.files[0].parent}: {str(error).splitlines()[0]}",
                hint=advice(view.files[0]),
            ) from None
    for name, view in bare(views).items():
        con.execute(f"CREATE VIEW main.{name} AS FROM {view.full}")


def catalog(root: Path) -> list[Listed]:
    """Every view that has files, by schema and name. Raises DamagedData."""
    listing = []
    for view in found(root):
        if view.files[0].suffix == ".ndjson":
            held = read_tombstones(view.files[0])
            rows, columns = held.num_rows, held.num_columns
        else:
            with reading(view.files):
                footers = [pq.read_metadata(path) for path in view.files]
            columns = len(footers[0].schema.to_arrow_schema())
            rows = sum(footer.num_rows for footer in footers)
        listing.append(Listed(view.schema, view.name, rows, columns, view.doc))
    return sorted(listing)


def _quoted(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
