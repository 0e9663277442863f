"""Writes and reads Parquet, so that no changed bit goes unnoticed.

Every page has a checksum, which readers of others can verify too; here every page is verified as it
is read. What lies between the pages is covered by the SHA-256 in the manifest of the file's folder
(kb.store.tables.checksums), which also covers rows that come by DuckDB: it verifies no page.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.regular_file import check_regular
from kb.store.damage import opening
from kb.store.tables import checksums

_BATCH = 1024  # rows that are decoded at a time


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


def write(path: Path, rows: pa.Table, **settings: Any) -> None:
    """Write a table as one file; `settings` as pyarrow has them."""
    with writing(path, rows.schema, **settings) as file:
        file.write_table(rows)


def open_file(path: Path | str, **settings: Any) -> pq.ParquetFile:
    """A file to read, after a check of its bytes; every page is verified. Raises DamagedData."""
    checksums.check(path)
    with opening(path, pa.ArrowException):
        return pq.ParquetFile(path, page_checksum_verification=True, **settings)


def read_footer(path: Path | str) -> pq.FileMetaData:
    """What the end of a file says of it: rows, groups and columns. Raises DamagedData."""
    with opening(path, pa.ArrowException):
        check_regular(path)
        return pq.read_metadata(path)


def read_schema(path: Path | str) -> pa.Schema:
    """The columns of a file. Raises DamagedData."""
    with opening(path, pa.ArrowException):
        check_regular(path)
        return pq.read_schema(path)


def read_table(path: Path | str, columns: Sequence[str] | None = None) -> pa.Table:
    """A whole file, or some columns of it. Raises DamagedData."""
    with opening(path, pa.ArrowException), open_file(path) as file:
        return file.read(columns=None if columns is None else list(columns))


def check(*paths: Path | str, advance: Callable[[int], None] | None = None) -> None:
    """Raises DamagedData for the first file whose bytes have changed since they were written.

    Call it before DuckDB reads rows of these files. `advance` is called with the number of bytes
    read.
    """
    checksums.check(*paths, advance=advance, unrecorded=decode)


def decode(path: Path) -> None:
    """Read every page of a file; nothing of one that is no Parquet. Raises DamagedData."""
    if path.suffix == ".ndjson":  # tombstones of a release: their reader checks every line
        return
    with opening(path, pa.ArrowException), open_file(path, pre_buffer=False) as file:
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
