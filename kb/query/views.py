"""DuckDB over a data root: a schema for each kind of table, with one view a table.

`clean.youtube_videos`, `release.reddit_posts`, `restored.reddit_comments`, `links.entities`; a
bare name is the clean view where it exists, else the released, else the restored one, else the
links'. Only files of these tables can be read: nothing is written, attached, loaded or fetched.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import duckdb
import pyarrow.parquet as pq

from kb.core.errors import DamagedData
from kb.core.sources import PUBLISHED, SOURCES
from kb.query.bounds import Limits
from kb.schema.tables import Table, table, tables
from kb.store import complete, database
from kb.store.advice import advice
from kb.store.layout import Layout, parquet_files
from kb.store.reading import escaped, reading, scan

SCHEMAS = ("clean", "release", "restored", "links")  # a bare name is the first of these that has it
_VERDICTS = ("rejected", "failed", "pending")
_SHARD = re.compile(r"([a-z][a-z0-9_]*?)(?:-[0-9]+(?:-of-[0-9]+)?)?\.parquet")


class View(NamedTuple):
    """A view that has files; `schema` is one of SCHEMAS, `doc` the table's one line."""

    schema: str
    name: str
    files: list[Path]
    doc: str

    @property
    def full(self) -> str:
        """ "clean.youtube_videos"."""
        return f"{self.schema}.{self.name}"


class Listed(NamedTuple):
    """A line of `kb query --tables`."""

    schema: str
    view: str
    rows: int
    columns: int
    about: str


def names(declared: Table) -> str:
    """The view's name of a declared table: "youtube_videos"; "pairs", "entities" and "links" bear
    their own names.
    """
    own = declared.source in PUBLISHED and declared.source not in SOURCES
    return declared.short if own else f"{declared.source}_{declared.short}"


def found(root: Path) -> Iterator[View]:
    """Every view that the data root has files for, in a fixed order."""
    for declared in tables().values():
        if declared.source in PUBLISHED:
            yield from _declared(root, declared)
    for source in PUBLISHED:
        yield from _kept_aside(root, source)
    yield from _restored(root)
    yield from _links(root)


def _declared(root: Path, declared: Table) -> Iterator[View]:
    name, short, source = names(declared), declared.short, declared.source
    at = Layout(root)
    if source != "links":  # it has a schema of its own
        yield from _view("clean", name, at.table(declared.name), "*.parquet", declared.doc)
    yield from _view("release", name, at.release(source), f"{short}-*-of-*.parquet", declared.doc)


def _kept_aside(root: Path, source: str) -> Iterator[View]:
    """What was rejected, failed or waits, and what was purged."""
    at = Layout(root)
    for verdict in _VERDICTS:
        place = at.clean(source, verdict)
        doc = table(f"shared/{verdict}").doc
        yield from _view("clean", f"{source}_{verdict}", place, "*.parquet", doc)
    doc, name, file = table("shared/tombstones").doc, f"{source}_tombstones", "tombstones.parquet"
    yield from _view("clean", name, at.raw(source), file, doc)
    yield from _view("release", name, at.release(source), file, doc)


def _restored(root: Path) -> Iterator[View]:
    """What `kb restore` and a reconstruction brought back."""
    at = Layout(root)
    for short in ("videos", "transcripts"):
        doc = table(f"youtube/{short}").doc
        place = at.restored("youtube", short)
        yield from _view("restored", f"youtube_{short}", place, "*.parquet", doc)
    yield from _rebuilt(root)
    doc = table("pairs/pairs").doc
    yield from _view("restored", "pairs", at.restored("pairs"), "*.parquet", doc)
    doc = table("shared/missing").doc
    yield from _view("restored", "missing", at.restored(), "missing.parquet", doc)


def _rebuilt(root: Path) -> Iterator[View]:
    """Posts and comments: restored, or of a reconstruction in its usual place, or `root` is its
    `--out` itself.
    """
    at = Layout(root)
    for place in (at.restored("reddit"), at.reconstructed, root):
        if not (place / "missing.parquet").is_file():
            continue
        for short in ("posts", "comments"):
            doc = table(f"reddit/{short}").doc
            yield from _view("restored", f"reddit_{short}", place / short, "*.parquet", doc)
        doc = table("reddit/missing").doc
        yield from _view("restored", "reddit_missing", place, "missing.parquet", doc)
        return


def _links(root: Path) -> Iterator[View]:
    shards: dict[str, list[Path]] = {}
    for path in parquet_files(Layout(root).links, "*.parquet"):
        if named := _SHARD.fullmatch(path.name):
            shards.setdefault(named[1], []).append(path)
    for name, files in shards.items():
        declared = tables().get(f"links/{name}")
        yield View("links", name, files, declared.doc if declared else "")


def _view(schema: str, name: str, folder: Path, pattern: str, doc: str) -> Iterator[View]:
    if files := parquet_files(folder, pattern):
        yield View(schema, name, files, doc)


def bare(views: Iterable[View]) -> dict[str, View]:
    """What a name without a schema stands for."""
    ranked = sorted(views, key=lambda view: SCHEMAS.index(view.schema), reverse=True)
    return {view.name: view for view in ranked}


def connect(
    root: Path | None, views: Sequence[View] | None = None, limits: Limits | None = None
) -> duckdb.DuckDBPyConnection:
    """An in-memory DuckDB with the data root's views, which can reach nothing else.

    `views`: these instead of what is found at `root`, with absolute paths; without a `root`
    nothing is written beside them. `limits`: of memory and what is spilled; time is
    `kb.query.bounds.bounded`'s. Raises DamagedData for a file that is no Parquet.
    """
    con = _open(root, limits)
    if views is None:
        views = list(found(root.absolute())) if root else []
        for folder in complete.tables(root.absolute()) if root else ():
            complete.check(folder)
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
            complete.check(view.files[0].parent)
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
        with reading(view.files):
            footers = [pq.read_metadata(path) for path in view.files]
        columns = len(pq.read_schema(view.files[0]))
        rows = sum(footer.num_rows for footer in footers)
        listing.append(Listed(view.schema, view.name, rows, columns, view.doc))
    return sorted(listing)


def _quoted(text: object) -> str:
    return "'" + str(text).replace("'", "''") + "'"
