"""The one place that opens Parquet, to write and to read, so that no changed bit goes unseen.

Every page that is written has a checksum, which other readers can check too. It says nothing of
what lies between the pages, and DuckDB doesn't look at it; so the footer of a file also holds the
CRC-32 of the whole file, reckoned with zeros in the place of its own eight digits:

    key-value metadata   lorebase.crc32 = 1f2e3d4c

`check` reads a file once for it, as fast as the disk is; a process does so once a file. Files of
others have none: of those the pages are verified, as far as they have checksums.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, BinaryIO

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.errors import DamagedData
from kb.store.advice import advice

KEY = b"lorebase.crc32"
CHANGED = "its bytes are not those that were written"
_ZEROS = b"00000000"
_FIELD = KEY + b"\x18\x08"  # in Thrift's compact form: the key, then a text of eight bytes
_TAIL = 8  # the footer's length and the magic bytes
_MOST = 64 << 20  # bytes of a footer
_CHUNK = 1 << 20
_PIECE, _BITS = 4, 8  # bytes of the name that are looked for, and how many bits may differ

_checked: set[tuple[str, int, int, int]] = set()  # files that this process has read in full


@contextlib.contextmanager
def writing(
    place: Path | IO[bytes], schema: pa.Schema, **settings: Any
) -> Iterator[pq.ParquetWriter]:
    """A pyarrow ParquetWriter of a new file with checksums, which stand when the block ends well.

    A stream gets those of its pages only. `settings` are the writer's own. The same rows in the
    same groups give the same bytes.
    """
    with pq.ParquetWriter(
        place, schema, compression="zstd", write_page_checksum=True, **settings
    ) as file:
        yield file
        if isinstance(place, Path):
            file.add_key_value_metadata({KEY.decode(): _ZEROS.decode()})
    if isinstance(place, Path):
        _seal(place)


def write(path: Path, rows: pa.Table, **settings: Any) -> None:
    """Write a table as one file; `settings` as pyarrow has them."""
    with writing(path, rows.schema, **settings) as file:
        file.write_table(rows)


def open_file(path: Path | str, **settings: Any) -> pq.ParquetFile:
    """A file to read, after `check`; every page is verified. Raises DamagedData."""
    check(path)
    return pq.ParquetFile(path, page_checksum_verification=True, **settings)


def read_table(path: Path | str, columns: Sequence[str] | None = None) -> pa.Table:
    """A whole file, or some columns of it. Raises DamagedData."""
    with open_file(path) as file:
        return file.read(columns=None if columns is None else list(columns))


def check(*paths: Path | str) -> None:
    """Raises DamagedData for the first file whose bytes are not what was written.

    What is no Parquet file at all passes: whoever opens it says so. DuckDB verifies nothing, so
    call it for files whose rows come by that way.
    """
    for path in map(Path, paths):
        about = path.stat()
        mark = str(path), about.st_ino, about.st_size, about.st_mtime_ns
        if mark not in _checked:
            if not holds(path):
                raise DamagedData(
                    f"{path} can't be read: {CHANGED}",
                    hint=advice(path),
                )
            _checked.add(mark)


def holds(path: Path, advance: Callable[[int], None] | None = None) -> bool:
    """Whether a file's bytes go with the checksum in its footer; true where it has none.

    `advance` hears how many bytes were read.
    """
    with path.open("rb") as file:
        at = _place(file)
        if at is None:
            return True
        file.seek(at)
        said = file.read(len(_ZEROS))
        return said == _reckoned(file, at, advance)


def has_checksum(path: Path) -> bool:
    """Whether a file says the checksum of its bytes."""
    with path.open("rb") as file:
        return _place(file) is not None


def _seal(path: Path) -> None:
    """Put the checksum of a file into its footer."""
    with path.open("r+b") as file:
        at = _place(file)
        assert at is not None, "the writer has made room for it"
        digits = _reckoned(file, at)
        file.seek(at)
        file.write(digits)


def _place(file: BinaryIO) -> int | None:
    """Where the digits stand; None in a file without them, or that is no Parquet."""
    size = file.seek(0, os.SEEK_END)
    if size < _TAIL:
        return None
    file.seek(size - _TAIL)
    length = int.from_bytes(file.read(4), "little")
    start = max(0, size - _TAIL - min(length, _MOST))
    file.seek(start)
    footer = file.read(size - start)
    # What the rows say (statistics) comes before it, so the last one is ours.
    found = footer.rfind(_FIELD)
    if found < 0:
        found = _nearly(footer)
    return None if found < 0 else start + found + len(_FIELD)


def _nearly(footer: bytes) -> int:
    """Where the name stands with a few bits changed, which must not hide it; -1: nowhere.

    A quarter of it at least has to be whole.
    """
    wanted, size = int.from_bytes(_FIELD, "big"), len(_FIELD)
    for begin in range(0, size, _PIECE):
        piece = _FIELD[begin : begin + _PIECE]
        at = footer.rfind(piece)
        while at >= begin:
            held = footer[at - begin : at - begin + size]
            if len(held) == size and (int.from_bytes(held, "big") ^ wanted).bit_count() <= _BITS:
                return at - begin
            at = footer.rfind(piece, 0, at + _PIECE - 1)
    return -1


def _reckoned(file: BinaryIO, at: int, advance: Callable[[int], None] | None = None) -> bytes:
    """The checksum of a file with zeros at `at`, as eight hexadecimal digits."""
    file.seek(0)
    value, place = 0, 0
    while chunk := file.read(_CHUNK):
        if place < at + len(_ZEROS) and at < place + len(chunk):
            changed = bytearray(chunk)
            for number, zero in enumerate(_ZEROS, at - place):
                if 0 <= number < len(chunk):
                    changed[number] = zero
            chunk = bytes(changed)
        value = zlib.crc32(chunk, value)
        place += len(chunk)
        if advance is not None:
            advance(len(chunk))
    return b"%08x" % value
