"""Files at addresses, as DuckDB reads them.

DuckDB asks for the ranges of a Parquet file that a query needs, ends early for a LIMIT and counts
by the footers. It verifies no page; tables that `kb.load` reads through Arrow are verified.
"""

from __future__ import annotations

import io
import threading
from datetime import UTC, datetime
from typing import Any, BinaryIO

import pyarrow as pa
from fsspec import AbstractFileSystem

from kb.core.cached_property import cached_property
from kb.core.errors import KbError
from kb.query.remote_reading import SCHEME
from kb.store.tables.remote_files import RemoteFolder, reading_at


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
        return {*self._files}

    def add_file(self, folder: RemoteFolder, name: str) -> str:
        """The address by which DuckDB reads a file of a folder."""
        address = f"{SCHEME}://{len(self._files)}/{name}"
        self._files[address] = _RemoteFile(folder, name)
        return address

    def open(self, path: str, mode: str = "rb", **_: Any) -> _RemoteFile:
        """A file that was added, at its beginning."""
        file = self._files[path]
        file.seek(0)
        return file

    def glob(self, path: str, **_: Any) -> list[str]:
        return [path] if path in self._files else []

    def info(self, path: str, **_: Any) -> dict[str, Any]:
        """Name and size."""
        file = self._files[path]
        return {"name": path, "size": file.size, "type": "file"}

    def modified(self, path: str) -> datetime:
        """The same time for all: a release does not change while it is read."""
        return datetime.fromtimestamp(0, UTC)


class _RemoteFile:
    """A file that threads read at their own positions; it stays open as long as its connection.

    A file that is no Parquet is small: it is read whole, and verified by SHA256SUMS.
    """

    def __init__(self, folder: RemoteFolder, name: str) -> None:
        self._folder, self._name = folder, name
        self.size = folder.sizes[name]
        self._mine, self._lock = threading.local(), threading.Lock()

    @cached_property
    def _file(self) -> BinaryIO:
        if self._name.endswith(".parquet"):
            return self._folder.open(self._name)
        return io.BytesIO(self._folder.read_file(self._name))

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move this thread's position."""
        self._mine.position = (0, self.tell(), self.size)[whence] + offset
        return self.tell()

    def tell(self) -> int:
        return int(getattr(self._mine, "position", 0))

    def close(self) -> None:
        """Nothing: DuckDB opens a file for each query, which costs a request."""

    def read(self, size: int = -1) -> bytes:
        """The next bytes. Raises DamagedData, FatalError."""
        start = self.tell()
        end = self.size if size < 0 else min(start + size, self.size)
        try:
            with reading_at(f"{self._folder}/{self._name}"), self._lock:
                self._file.seek(start)
                data = self._file.read(end - start)
                if len(data) != end - start:
                    raise pa.ArrowInvalid("it ends early")
        except KbError as error:
            self._folder.failures.append(error)
            raise
        self._mine.position = end
        return data
