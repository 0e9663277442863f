"""Files at addresses, as DuckDB reads them.

DuckDB asks for the ranges of a Parquet file that a query needs, ends early for a LIMIT and counts
by the footers, but verifies no page. So Arrow, which does, decodes each column chunk before DuckDB
gets it.
"""

from __future__ import annotations

import bisect
import contextlib
import io
import threading
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any, BinaryIO, NamedTuple

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
from fsspec import AbstractFileSystem

from kb.artifacts.table_catalog import View
from kb.core.cached_property import cached_property
from kb.core.errors import KbError
from kb.store.tables.remote_files import RemoteFolder, reading_at

SCHEME = "address"
_TAIL = 64 << 10  # bytes at a file's end that are read at once and kept


@contextlib.contextmanager
def reading_views(views: Iterable[View]) -> Iterator[None]:
    """Raises what went wrong with a file at an address, of which DuckDB keeps the text only."""
    folders = [view.remote.folder for view in views if view.remote is not None]
    for folder in folders:
        folder.failures.clear()
    try:
        yield
    except (duckdb.Error, pa.ArrowException, OSError):
        for folder in folders:
            if folder.failures:
                raise folder.failures[0] from None
        raise


class RemoteFiles(AbstractFileSystem):  # type: ignore[misc]  # fsspec has no types
    """The file system of one connection: the files that were added to it, each at an address that
    only this connection knows.
    """

    protocol = SCHEME
    cachable = False

    def __init__(self) -> None:
        super().__init__()
        self._files: dict[str, _RemoteFile] = {}

    @property
    def addresses(self) -> set[str]:
        """Of all files that were added."""
        return {*self._files}

    def add(self, folder: RemoteFolder, name: str) -> str:
        """The address by which DuckDB reads a file of a folder."""
        address = f"{SCHEME}://{len(self._files)}/{name}"
        kind = _VerifiedParquet if name.endswith(".parquet") else _WholeFile
        self._files[address] = kind(folder, name)
        return address

    def open(self, path: str, mode: str = "rb", **_: Any) -> _RemoteFile:
        """A file that was added, at its beginning."""
        file = self._files[path]
        file.seek(0)
        return file

    def glob(self, path: str, **_: Any) -> list[str]:
        """The file of this name, if it was added."""
        return [path] if path in self._files else []

    def info(self, path: str, **_: Any) -> dict[str, Any]:
        """Name and size."""
        file = self._files[path]
        return {"name": path, "size": file.size, "type": "file"}

    def modified(self, path: str) -> datetime:
        """The same time for all: a release does not change while it is read."""
        return datetime.fromtimestamp(0, UTC)


class _RemoteFile:
    """A file that threads read at their own positions; it stays open as long as its connection."""

    def __init__(self, folder: RemoteFolder, name: str) -> None:
        self._folder, self._name = folder, name
        self.size = folder.sizes[name]
        self._mine = threading.local()

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move this thread's position."""
        self._mine.position = (0, self.tell(), self.size)[whence] + offset
        return self.tell()

    def tell(self) -> int:
        """This thread's position."""
        return int(getattr(self._mine, "position", 0))

    def close(self) -> None:
        """Nothing: DuckDB opens a file for each query, which costs a request."""

    def read(self, size: int = -1) -> bytes:
        """The next bytes, verified. Raises DamagedData, FatalError."""
        start = self.tell()
        end = self.size if size < 0 else min(start + size, self.size)
        try:
            with reading_at(f"{self._folder}/{self._name}"):
                data = self._verified(start, end)
        except KbError as error:
            self._folder.failures.append(error)
            raise
        self._mine.position = end
        return data

    def _verified(self, start: int, end: int) -> bytes:
        raise NotImplementedError


class _WholeFile(_RemoteFile):
    """A small file, verified by SHA256SUMS."""

    def _verified(self, start: int, end: int) -> bytes:
        return self._data[start:end]

    @cached_property
    def _data(self) -> bytes:
        return self._folder.read(self._name)


class _ColumnChunk(NamedTuple):
    """Where a column of a row group lies in its file."""

    start: int
    end: int
    group: int
    column: str


class _VerifiedParquet(_RemoteFile):
    """A Parquet file, verified by the checksums of its pages."""

    def __init__(self, folder: RemoteFolder, name: str) -> None:
        super().__init__(folder, name)
        self._lock = threading.Lock()

    def _verified(self, start: int, end: int) -> bytes:
        chunks = self._chunks_between(start, end)
        if end == self.size and not (chunks and chunks[0].start >= start):
            # The footer, of which DuckDB guesses the size: it does not use what lies before it.
            return self._tail.footer.rjust(end - start, b"\0")[start - end :]
        first = min([start, *(chunk.start for chunk in chunks)])
        data = self._fetch(first, max([end, *(chunk.end for chunk in chunks)]))
        self._verify(chunks, first, data)
        return data[start - first : end - first]

    def _fetch(self, start: int, end: int) -> bytes:
        tail = self._tail
        if start >= tail.first:
            return tail.data[start - tail.first : end - tail.first]
        return self._transfer(start, end)

    def _transfer(self, start: int, end: int) -> bytes:
        with self._lock:
            self._file.seek(start)
            data: bytes = self._file.read(end - start)
        if len(data) != end - start:
            raise pa.ArrowInvalid("it ends early")
        return data

    def _verify(self, chunks: list[_ColumnChunk], first: int, data: bytes) -> None:
        """Decode column chunks, which compares the checksums of their pages."""
        columns: dict[int, list[str]] = {}
        for chunk in chunks:
            columns.setdefault(chunk.group, []).append(chunk.column)
        file = pq.ParquetFile(
            pa.PythonFile(_Range(first, data, self.size), mode="r"),
            metadata=self._tail.metadata,
            page_checksum_verification=True,
            pre_buffer=False,
        )
        for group, names in columns.items():
            file.read_row_group(group, columns=names, use_threads=False)

    def _chunks_between(self, start: int, end: int) -> list[_ColumnChunk]:
        """The column chunks that a range touches, in the file's order."""
        first = bisect.bisect_right(self._chunks, start, key=lambda chunk: chunk.end)
        last = bisect.bisect_left(self._chunks, end, key=lambda chunk: chunk.start)
        return self._chunks[first:last]

    @cached_property
    def _file(self) -> BinaryIO:
        return self._folder.open(self._name)

    @cached_property
    def _tail(self) -> _Tail:
        size = min(self.size, _TAIL)
        while True:
            first = self.size - size
            data = self._transfer(first, self.size)
            needed = int.from_bytes(data[-8:-4], "little") + 8
            if needed <= size or size == self.size:
                break
            size = min(self.size, needed)
        source = pa.PythonFile(_Range(first, data, self.size), mode="r")
        return _Tail(first, data, data[-needed:], pq.read_metadata(source))

    @cached_property
    def _chunks(self) -> list[_ColumnChunk]:
        metadata = self._tail.metadata
        chunks = []
        for group in range(metadata.num_row_groups):
            row_group = metadata.row_group(group)
            for number in range(row_group.num_columns):
                column = row_group.column(number)
                start = column.dictionary_page_offset or column.data_page_offset
                end = start + column.total_compressed_size
                chunks.append(_ColumnChunk(start, end, group, column.path_in_schema))
        return sorted(chunks)


class _Tail(NamedTuple):
    """The end of a Parquet file, from `first` on, with its footer, and what that says."""

    first: int
    data: bytes
    footer: bytes
    metadata: pq.FileMetaData


class _Range(io.BytesIO):
    """A range of a file, at the file's own offsets."""

    def __init__(self, first: int, data: bytes, size: int) -> None:
        super().__init__(data)
        self._first, self._size = first, size

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to an offset of the file."""
        base = (0, self.tell(), self._size)[whence]
        return super().seek(base + offset - self._first) + self._first

    def tell(self) -> int:
        """The offset in the file."""
        return super().tell() + self._first
