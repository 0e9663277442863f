"""Decompresses dumps: zstd, Arctic Shift's zst_blocks, gzip, or plain NDJSON, recognized by their
first bytes, never by their names.

    zstd        frames with windows of up to 2^31, also several and skippable ones
    zst_blocks  uint32 size and a zstd frame, repeated; the content is a uint32 number of
                rows, (uint32 offset, uint32 size) of each, and the rows without line ends, all
                little-endian. Source: https://github.com/ArthurHeitmann/zst_blocks_format
    gzip        members one after the other
    plain       lines that begin with an object

A truncated or damaged file yields everything before the damage, and `ReadProgress` says so.
"""

import gzip
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import add
from pathlib import Path
from typing import BinaryIO

import zstandard

from kb.core.errors import SettingError

# Every chunk is searched several times, so it should fit the processor's cache (see tests/bench).
CHUNK = 512 << 10  # decompressed bytes of a chunk, about
_PIECE = 32 << 10  # compressed bytes that are read at once; zstd expands them 10 to 30 times
_LARGEST = 256 << 20  # decompressed bytes of a block of zst_blocks; Arctic Shift's have about 1 MiB
_HEAD = 18  # bytes of the longest header of a zstd frame
_WORKSPACE = 32 << 20  # memory besides the window: a chunk and copies of it
_FRAME, _SKIPPED = b"\x28\xb5\x2f\xfd", b"\x2a\x4d\x18"
_GZIP, _BOM = b"\x1f\x8b\x08", b"\xef\xbb\xbf"


@dataclass
class ReadProgress:
    """Counts and problems of a dump that is being read."""

    lines: int = 0
    bad_lines: int = 0
    first_bad: int | None = None  # offset of the first of them in the decompressed file
    truncated: bool = False
    problem: str = ""
    stopped: bool = False  # on request, before the end

    def count_damaged(self, number: int, first: int | None) -> None:
        """Count damaged lines, the first of which begins at `first`."""
        self.bad_lines += number
        if self.first_bad is None:
            self.first_bad = first


Read = Callable[[BinaryIO, ReadProgress], Iterator[bytes]]


def pieces(path: Path, progress: ReadProgress) -> Iterator[bytes]:
    """The decompressed bytes of a dump, about CHUNK at once, without a byte order mark.

    Raises SettingError for a file that is not a dump or can't be read.
    """
    first = True
    with path.open("rb", buffering=1 << 20) as file:
        for piece in _reader(path)(file, progress):
            yield piece.removeprefix(_BOM) if first else piece
            first = False


def check(path: Path) -> None:
    """Raise SettingError for a file that is not a dump or can't be read."""
    _reader(path)


def memory(path: Path) -> int:
    """Bytes that reading a dump takes: its first frame's window (2 GiB in the archives' zstd files)
    or its first block, and a decompressed chunk.
    """
    read = _reader(path)
    with path.open("rb") as file:
        if read is _of_blocks:
            file.seek(4)
        head = file.read(_HEAD)
        while head[1:4] == _SKIPPED and len(head) >= 8:
            file.seek(int.from_bytes(head[4:8], "little") - len(head) + 8, 1)
            head = file.read(_HEAD)
    try:
        frame = zstandard.get_frame_parameters(head)
    except zstandard.ZstdError:
        return _WORKSPACE
    if read is _of_blocks:
        return 2 * min(int(frame.content_size), _LARGEST) + _WORKSPACE
    return int(frame.window_size) + _WORKSPACE


def _reader(path: Path) -> Read:
    """What decompresses a file, by its first bytes."""
    try:
        with path.open("rb") as file:
            head = file.read(8)
            if _is_zstd(head):
                return _of_zstd
            if head[4:] == _FRAME:
                return _of_blocks
            if head.startswith(_GZIP):
                return _of_gzip
            while head and not (text := head.removeprefix(_BOM).strip()):
                head = file.read(CHUNK)
            if not head or text.startswith(b"{"):
                return _of_plain
    except OSError as error:
        raise SettingError(
            f"cannot read {path}: {error.strerror}", hint="give paths of dumps that exist"
        ) from None
    raise SettingError(
        f"{path} is not a dump: it is neither zstd, zst_blocks nor gzip, and does not start with"
        " a JSON object",
        hint="name RS_* and RC_* files, or files of one subreddit",
    )


def _is_zstd(head: bytes) -> bool:
    return head.startswith(_FRAME) or (head[1:4] == _SKIPPED and head[0] & 0xF0 == 0x50)


def _of_plain(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    while piece := file.read(CHUNK):
        yield piece


def _of_gzip(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    with gzip.GzipFile(fileobj=file) as members:
        try:
            while piece := members.read1(CHUNK):
                yield piece
        except EOFError:
            progress.truncated, progress.problem = True, "the last gzip member is cut off"
        except (OSError, zlib.error) as error:
            progress.truncated, progress.problem = True, f"damaged gzip member: {error}"


def _of_blocks(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    while head := file.read(4):
        size = int.from_bytes(head, "little")
        block = file.read(min(size, _LARGEST))
        try:
            rows, complete = _rows(engine, block)
        except zstandard.ZstdError as error:
            progress.truncated, progress.problem = True, f"damaged block: {error}"
            return
        step = max(1, len(rows) * CHUNK // (sum(map(len, rows)) + 1))
        for begin in range(0, len(rows), step):
            yield b"\n".join([*rows[begin : begin + step], b""])
        if len(block) < size or not complete:
            progress.truncated, progress.problem = True, "the last block is cut off"
            return


def _rows(engine: zstandard.ZstdDecompressor, block: bytes) -> tuple[list[bytes], bool]:
    """The rows of a block, and whether these are all. Raises ZstdError for a damaged one."""
    size = zstandard.frame_content_size(block)
    if size > _LARGEST:
        raise zstandard.ZstdError(f"it has {size} bytes")
    try:
        data = engine.decompress(block, max_output_size=_LARGEST)
    except zstandard.ZstdError:
        with engine.stream_reader(block) as reader:  # gives what comes before a cut
            data = reader.read(size if size >= 0 else _LARGEST)
    number = int.from_bytes(data[:4], "little")
    begin = 4 + 8 * number
    if len(data) < begin:
        return [], False
    places = struct.unpack_from(f"<{2 * number}I", data, 4)
    starts, sizes = places[::2], places[1::2]
    if sum(sizes) > _LARGEST:
        raise zstandard.ZstdError("its rows overlap")
    data, ends = data[begin:], list(map(add, starts, sizes))
    rows = [data[start:end] for start, end in zip(starts, ends, strict=True)]
    if max(ends, default=0) <= len(data):
        return rows, True
    return [row for row, end in zip(rows, ends, strict=True) if end <= len(data)], False


def _of_zstd(file: BinaryIO, progress: ReadProgress) -> Iterator[bytes]:
    """A loop over frames: python-zstandard's stream reader does not report a truncated file, and a
    plain decompressor stops after the first frame.
    """
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    frame, fresh = engine.decompressobj(write_size=CHUNK), True
    while rest := file.read(_PIECE):
        while rest:
            try:
                data = frame.decompress(rest)
            except zstandard.ZstdError as error:
                progress.truncated, progress.problem = True, f"damaged frame: {error}"
                return
            fresh = False
            for at in range(0, len(data), CHUNK):
                yield data[at : at + CHUNK]
            rest = frame.unused_data if frame.eof else b""
            if frame.eof:
                frame, fresh = engine.decompressobj(write_size=CHUNK), True
    if not fresh:
        progress.truncated, progress.problem = True, "the last frame is cut off"
