"""Writes and reads Parquet, so that no changed bit goes unnoticed, and nothing is read of a release
whose columns or numbers are not as schemas/ declares them.

Every page has a checksum, which readers of others can verify too; here every page is verified as it
is read. What lies between the pages is covered by the SHA-256 in the manifest of the file's folder
(kb.store.tables.checksums), which also covers rows that come by DuckDB: it verifies no page.
"""

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from kb.schema.conformity import column_problems, limited, value_problem
from kb.schema.tables import Table, tables
from kb.store.damage import opening, unreadable
from kb.store.tables import checksums

_BATCH = 1024  # rows that are decoded at a time
_NUMBERS = 65_536  # the same of columns of numbers alone
_SHARD = re.compile(r"([a-z][a-z0-9_]*)-[0-9]{5}-of-[0-9]{5}\.parquet")


@contextlib.contextmanager
def writing(
    place: Path | IO[bytes], schema: pa.Schema, **settings: Any
) -> Iterator[pq.ParquetWriter]:
    """A pyarrow ParquetWriter of a new file with page checksums; `settings` are the writer's own.

    The same rows in the same groups give the same bytes.
    """
    with pq.ParquetWriter(
        place, schema, compression="zstd", write_page_checksum=True, **settings
    ) as file:
        yield file


def write_file(path: Path, rows: pa.Table, **settings: Any) -> None:
    """Write a table as one file; `settings` as pyarrow has them."""
    with writing(path, rows.schema, **settings) as file:
        file.write_table(rows)


def open_file(path: Path | str, **settings: Any) -> pq.ParquetFile:
    """A file to read, after a check of its bytes and, of a release, of its columns and numbers;
    every page is verified. Raises DamagedData.
    """
    checksums.verify_recorded(path)
    check_release(path)
    return _opened(path, **settings)


def footer(path: Path | str) -> pq.FileMetaData:
    """Rows and columns of a file, whose rows are not looked at. Raises DamagedData, of a release
    also for columns that are not as declared.
    """
    check_release(path, values=False)
    with _opened(path) as file:
        return file.metadata


def names(path: Path | str) -> list[str]:
    """The columns of a file. Raises DamagedData as `footer`."""
    return footer(path).schema.to_arrow_schema().names


def open_stored(path: Path | str, **settings: Any) -> pq.ParquetFile:
    """The same after a check of its bytes alone, for who compares the rest itself."""
    checksums.verify_recorded(path)
    return _opened(path, **settings)


def check_release(*paths: Path | str, values: bool = True) -> None:
    """Raises DamagedData for the first file of a release whose columns are not as declared, or,
    with `values`, whose numbers and times are not; without, only footers are read.
    """
    for path in map(Path, paths):
        declared = released_table(path.name)
        if declared is not None:
            with opening(path):
                about = path.stat()
            _compare(path, declared.name, values, about.st_ino, about.st_size, about.st_mtime_ns)


def _opened(path: Path | str, **settings: Any) -> pq.ParquetFile:
    with opening(path, pa.ArrowException):
        place = checksums.library_path(path)
        return pq.ParquetFile(place, page_checksum_verification=True, **settings)


def read_table(path: Path | str, columns: Sequence[str] | None = None) -> pa.Table:
    """A whole file, or some columns of it. Raises DamagedData."""
    with opening(path, pa.ArrowException), open_file(path) as file:
        return file.read(columns=None if columns is None else list(columns))


def verify_files(*paths: Path | str, advance: Callable[[int], None] | None = None) -> None:
    """Raises DamagedData for the first file whose bytes have changed since they were written, and
    for one of a release whose columns or numbers are not as declared.

    Call it before DuckDB reads rows of these files. `advance` is called with the number of bytes
    read.
    """
    checksums.verify_recorded(*paths, advance=advance, unrecorded=decode)
    check_release(*paths)


def released_table(name: str) -> Table | None:
    """The table of which a file is a shard in a release, by its name."""
    match = _SHARD.fullmatch(name)
    return _released().get(match[1]) if match else None


def is_released(path: Path | str) -> bool:
    """Whether a file is, by its name, a shard of a release or its list of tombstones."""
    name = Path(path).name
    return released_table(name) is not None or name.endswith(".ndjson")


@cache
def _released() -> dict[str, Table]:
    return {
        stem: declared
        for declared in tables().values()
        if declared.released
        for stem in declared.stems
    }


@lru_cache(maxsize=10_000)
def _compare(path: Path, name: str, values: bool, *_stamp: int) -> None:
    """Once in a process for a file that stays as it is: numbers are read in full."""
    declared = tables()[name]
    with opening(path, pa.ArrowException), _opened(path, pre_buffer=False) as file:
        for _, what in column_problems(declared, file.schema_arrow, released=True):
            raise unreadable(path, what)
        for _, what in value_problems(file, declared) if values else ():
            raise unreadable(path, what)


def value_problems(file: pq.ParquetFile, declared: Table) -> Iterator[tuple[str, str]]:
    """(column, what is wrong) of released columns with numbers or times outside their ranges, for
    each piece of the file.
    """
    columns = [column for column in declared.columns if column.released and limited(column)]
    names = [column.name for column in columns]
    for rows in file.iter_batches(_NUMBERS, columns=names) if names else ():
        for column in columns:
            if what := value_problem(column, rows.column(column.name)):
                yield column.name, what


def decode(path: Path) -> None:
    """Read every page of a file; nothing of one that is no Parquet. Raises DamagedData."""
    if path.suffix == ".ndjson":  # tombstones of a release: their reader checks every line
        return
    with opening(path, pa.ArrowException), open_stored(path, pre_buffer=False) as file:
        for _ in file.iter_batches(batch_size=_BATCH, use_threads=False):
            pass


def content_digest(path: Path) -> str:
    """What tells a file from one with other content, wherever and whenever it was copied: its
    SHA-256, which is computed only where it is not recorded.
    """
    entry = checksums.recorded(path)
    if entry is not None and entry.size in (0, path.stat().st_size):
        return entry.sha256
    return checksums.digest(path)
