"""The one place that opens Parquet, to write and to read, so that no changed bit goes unseen.

Every page that is written has a checksum, which other readers can check too. It says nothing of
what lies between the pages, and DuckDB doesn't look at it; so the footer of a file also holds the
CRC-32 of the whole file, computed with zeros in the place of its own eight digits, and that of the
footer alone, with zeros in the place of both:

    key-value metadata   lorebase.crc32 = 1f2e3d4c, lorebase.footer = 5a6b7c8d

Whoever reads rows calls `check`, which reads a file once for it, as fast as the disk is; a process
does so once a file. Whoever needs counts or columns alone asks `footer`, at no cost. Files of
others have neither: of those the pages are verified, as far as they have checksums.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.errors import DamagedData
from kb.store.advice import advice
from kb.store.digests import digest

# Names on disk, kept from the time before the project was renamed.
KEY = b"lorebase.crc32"
FOOTER = b"lorebase.footer"
CHANGED = "its bytes are not those that were written"
_ZEROS = b"00000000"
_EIGHT = b"\x18\x08"  # in Thrift's compact form: a text of eight bytes
_TAIL = 8  # the footer's length and the magic bytes
_MOST = 64 << 20  # bytes of a footer
_CHUNK = 1 << 20
_AT_ONCE = 4  # files that are read at a time
_PIECE, _BITS = 4, 8  # bytes of the name that are looked for, and how many bits may differ


class _Mark(NamedTuple):
    """A file as it is now: another one has another inode, size or time."""

    path: str
    inode: int
    size: int
    changed: int


_checked: set[_Mark] = set()  # files that this process has read in full


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
            zeros = _ZEROS.decode()
            file.add_key_value_metadata({KEY.decode(): zeros, FOOTER.decode(): zeros})
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


def footer(path: Path | str) -> pq.FileMetaData:
    """What a file's footer says of rows and columns, against its checksum; no row is read.

    Raises DamagedData, and what pyarrow raises for a file that is no Parquet.
    """
    with Path(path).open("rb") as file:
        held = _footer(file)[1]
    own, whole = _place(held, FOOTER), _place(held, KEY)
    if (own is None) != (whole is None):
        raise _changed(Path(path))
    if own is not None and whole is not None:
        said = held[own : own + len(_ZEROS)]
        for place in (own, whole):
            held = held[:place] + _ZEROS + held[place + len(_ZEROS) :]
        if said != b"%08x" % zlib.crc32(held):
            raise _changed(Path(path))
    return pq.read_metadata(path)


def check(*paths: Path | str, advance: Callable[[int], None] | None = None) -> None:
    """Raises DamagedData for the first file whose bytes are not what was written.

    What is no Parquet file at all passes: whoever opens it says so. DuckDB verifies nothing, so
    call it for files whose rows come by that way. `advance` hears how many bytes were read.
    """
    fresh = _unchecked(paths)
    if len(fresh) > 1 and sum(mark.size for mark in fresh) > _CHUNK:
        with ThreadPoolExecutor(min(_AT_ONCE, len(fresh))) as pool:
            whole = list(pool.map(lambda mark: holds(Path(mark.path), advance), fresh))
    else:
        whole = [holds(Path(mark.path), advance) for mark in fresh]
    for mark, is_whole in zip(fresh, whole, strict=True):
        if not is_whole:
            raise _changed(Path(mark.path))
        _checked.add(mark)


def unread(paths: Iterable[Path | str]) -> int:
    """How many bytes `check` would read."""
    return sum(mark.size for mark in _unchecked(paths))


def _unchecked(paths: Iterable[Path | str]) -> list[_Mark]:
    marks = []
    for path in dict.fromkeys(map(str, paths)):
        about = os.stat(path)  # noqa: PTH116  of many files
        marks.append(_Mark(path, about.st_ino, about.st_size, about.st_mtime_ns))
    return [mark for mark in marks if mark not in _checked]


def _changed(path: Path) -> DamagedData:
    return DamagedData(f"{path} can't be read: {CHANGED}", hint=advice(path))


def holds(path: Path, advance: Callable[[int], None] | None = None) -> bool:
    """Whether a file's bytes go with the checksum in its footer; true where it has none.

    `advance` hears how many bytes were read.
    """
    with path.open("rb") as file:
        at = _whole(file)
        if at is None:
            return True
        file.seek(at)
        said = file.read(len(_ZEROS))
        return said == _crc_of(file, at, advance)


def fingerprint(path: Path) -> str:
    """What tells a file from one with other content, wherever and whenever it was copied: its size
    and the checksum in its footer, else its SHA-256.
    """
    with path.open("rb") as file:
        at = _whole(file)
        if at is not None:
            file.seek(at)
            return f"{path.stat().st_size}-{file.read(len(_ZEROS)).decode(errors='replace')}"
    return digest(path)


def has_checksum(path: Path) -> bool:
    """Whether a file says the checksum of its bytes."""
    with path.open("rb") as file:
        return _whole(file) is not None


def _seal(path: Path) -> None:
    """Put the checksums of a file into its footer: first the footer's, then that of all bytes."""
    with path.open("r+b") as file:
        begin, held = _footer(file)
        own, whole = _place(held, FOOTER), _place(held, KEY)
        assert own is not None, "the writer has made room for it"
        assert whole is not None
        file.seek(begin + own)
        file.write(b"%08x" % zlib.crc32(held))
        digits = _crc_of(file, begin + whole)
        file.seek(begin + whole)
        file.write(digits)


def _footer(file: BinaryIO) -> tuple[int, bytes]:
    """Where the footer begins, as far as the file says it, and its bytes to the file's end."""
    size = file.seek(0, os.SEEK_END)
    if size < _TAIL:
        return 0, b""
    file.seek(size - _TAIL)
    length = int.from_bytes(file.read(4), "little")
    begin = max(0, size - _TAIL - min(length, _MOST))
    file.seek(begin)
    return begin, file.read(size - begin)


def _whole(file: BinaryIO) -> int | None:
    """Where the digits of the whole file stand; None in a file without them, or no Parquet."""
    begin, held = _footer(file)
    at = _place(held, KEY)
    return None if at is None else begin + at


def _place(footer: bytes, key: bytes) -> int | None:
    """Where a key's digits stand in a footer."""
    # What the rows say (statistics) comes before it, so the last one is ours.
    field = key + _EIGHT
    place = footer.rfind(field)
    if place < 0:
        place = _nearly(footer, field)
    return None if place < 0 else place + len(field)


def _nearly(footer: bytes, field: bytes) -> int:
    """Where the name stands with a few bits changed, which must not hide it; -1: nowhere.

    Some four bytes of it have to be whole.
    """
    wanted, size = int.from_bytes(field, "big"), len(field)
    for begin in range(0, size - _PIECE + 1, _PIECE):
        piece = field[begin : begin + _PIECE]
        at = footer.rfind(piece)
        while at >= begin:
            held = footer[at - begin : at - begin + size]
            if len(held) == size and (int.from_bytes(held, "big") ^ wanted).bit_count() <= _BITS:
                return at - begin
            at = footer.rfind(piece, 0, at + _PIECE - 1)
    return -1


def _crc_of(file: BinaryIO, at: int, advance: Callable[[int], None] | None = None) -> bytes:
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
