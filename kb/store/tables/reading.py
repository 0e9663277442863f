"""How the data root's own files are read: paths are taken literally, and an error names the damaged
file and what to do.

with reading(files):                    # what a library says of a broken file becomes DamagedData
    con.execute(f"SELECT count(*) FROM {scan(files)}")
"""

import contextlib
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa

from kb.core.errors import DamagedData
from kb.schema.conformity import column_problems
from kb.schema.tables import table, tables
from kb.store.damage import read_note, unreadable
from kb.store.exhausted import is_out_of_memory
from kb.store.layout import Layout
from kb.store.state.frontier import Frontier
from kb.store.tables import checksums, parquet

SANDBOX_MODEL = "lorecrawl_tiny"  # what its scores say means nothing about real texts


@contextlib.contextmanager
def reading(files: Iterable[Path | str]) -> Iterator[None]:
    """Raises DamagedData for the first of these Parquet files that can't be read, when that is why
    the block failed.

    Nothing is read unless the block fails, and an error that no file explains stays what it is.
    """
    try:
        yield
    except Exception as error:
        if _a_readers(error) and not is_out_of_memory(error) and (damage := broken(files)):
            raise damage from error
        raise


def broken(files: Iterable[Path | str]) -> DamagedData | None:
    """The first file that can't be read, as an error; None when all can.

    Every page is decoded, then the columns are compared with the table that belongs there.
    """
    paths = [*map(Path, files)]
    for path in paths:
        try:
            parquet.decode(path)
        except DamagedData as error:
            return error
    for path in paths:
        if what := _other(path):
            return unreadable(path, what)
    return None


def _other(path: Path) -> str:
    """In what a file's columns are not those that its place in a data root promises."""
    name = _declared(path)
    if name not in tables() or path.suffix == ".ndjson":
        return ""
    with parquet.open_stored(path) as file:
        stored = file.schema_arrow
    problems = column_problems(table(name), stored, released=False)
    return next((what for _, what in problems), "")


def _declared(path: Path) -> str:
    """The table that a file of a data root should be, "" for one that is elsewhere."""
    match path.parts[::-1]:
        case (_, name, source, "clean", *_):
            return f"{source}/{name}" if f"{source}/{name}" in tables() else f"shared/{name}"
        case (_, _, "releases" | "restored", *_):
            return ""
        case (name, ("pairs" | "films") as folder, *_):
            return f"{folder}/{name.partition('-')[0]}"
        case (_, "labels", *_):
            return "labels/labels"
        case (name, "links", *_):
            return f"links/{name.partition('-')[0]}"
        case (_, _, "annotations", *_):
            return "shared/annotations"
    return ""


def filtered(root: Path, source: str) -> dict[str, Any]:
    """The summary of the source's last filter, {} when there was none. Raises DamagedData."""
    return read_note(Layout(root).summary(source), dict[str, Any]) or {}


def scan(files: Iterable[Path | str]) -> str:
    """SQL that reads these files and no others. Raises DamagedData for what is no regular file, for
    a link whose bytes are not those that checksums describe, and for a file of a release whose
    columns or numbers are not as declared.
    """
    names = list(map(str, files))
    return sql_of(library_paths(names), any(name.endswith(".ndjson") for name in names))


def library_paths(files: Iterable[Path | str], *, values: bool = True) -> list[str]:
    """The paths by which DuckDB opens these files. Without `values`, for a view whose rows are
    looked at when they are read, a data root's files after the first are not opened. Raises
    DamagedData as `scan`.
    """
    paths: list[str] = []
    for name in map(str, files):
        is_local = "://" not in name
        if is_local:
            parquet.check_release(name, values=values)
        if is_local and (values or not paths or parquet.is_released(name)):
            paths.append(checksums.library_path(name))
        else:
            paths.append(name)
    return paths


def sql_of(paths: Sequence[str], lines: bool) -> str:
    """SQL that reads files by their paths in a library: Parquet, or `lines`: tombstones of a
    release.
    """
    listed = ", ".join(map(literal, paths))
    if lines:
        kinds = ", ".join(
            f"'{field.name}': '{'TIMESTAMPTZ' if pa.types.is_timestamp(field.type) else 'VARCHAR'}'"
            for field in table("shared/tombstones").arrow(True)
        )
        return f"read_json([{listed}], format = 'newline_delimited', columns = {{{kinds}}})"
    return f"read_parquet([{listed}])"


def literal(path: Path | str) -> str:
    """A path in SQL as DuckDB takes it: a name may hold quotes and what would be a pattern."""
    return text_literal(escaped(str(path)))


def text_literal(text: str) -> str:
    """A text in SQL."""
    return "'" + text.replace("'", "''") + "'"


def escaped(path: str) -> str:
    """A path as a pattern that only it matches."""
    return re.sub(r"([*?\[])", r"[\1]", path)


@contextlib.contextmanager
def state(
    path: Path, payloads: Mapping[str, type[msgspec.Struct]] | None = None
) -> Iterator[Frontier]:
    """A source's state, read beside a running crawl; `payloads` as there. Raises DamagedData,
    DiskFull: even to read it SQLite may need room for a file beside it.
    """
    with contextlib.closing(Frontier(path, readonly=True, payloads=payloads)) as frontier:
        yield frontier


def _a_readers(error: Exception) -> bool:
    """Whether a library may say so of a broken file: Arrow and DuckDB have errors of their own,
    OSErrors without a number, and errors for names that are not there or not text.
    """
    kinds = [
        getattr(sys.modules.get(name), kind, None)
        for name, kind in (("pyarrow", "ArrowException"), ("duckdb", "Error"))
    ]
    return isinstance(error, tuple(kind for kind in kinds if kind)) or (
        isinstance(error, (KeyError, UnicodeDecodeError))
        or (isinstance(error, OSError) and error.errno is None)
    )
