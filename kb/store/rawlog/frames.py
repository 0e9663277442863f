"""The zstd frames of a file that may be damaged."""

from collections.abc import Iterator
from typing import BinaryIO

import zstandard

MAGIC = b"\x28\xb5\x2f\xfd"
_WINDOW = 1 << 31
_CHUNK = 1 << 16  # small, as the rest of a chunk is copied once for each frame in it


def intact_frames(file: BinaryIO, at: int) -> Iterator[tuple[int, int, bytes]]:
    """(start, end, content) of every whole frame from `at` on, whatever lies between them."""
    engine = _engine()
    file.seek(at)
    rest = file.read(_CHUNK)
    while rest:
        frame = _frame(engine, file, rest)
        if frame is None:
            following = _next_frame(file, at + 1)
            if following is None:
                return
            at = following
            file.seek(at)
            rest = file.read(_CHUNK)
            continue
        content, used, rest = frame
        yield at, at + used, content
        at += used
        rest = rest or file.read(_CHUNK)


def _engine() -> zstandard.ZstdDecompressor:
    return zstandard.ZstdDecompressor(max_window_size=_WINDOW)


def _frame(
    engine: zstandard.ZstdDecompressor, file: BinaryIO, rest: bytes
) -> tuple[bytes, int, bytes] | None:
    """A frame that begins with `rest`: content, size, and what was read behind it;
    None: damaged.
    """
    frame = engine.decompressobj()
    parts, used = [], 0
    while rest:
        try:
            parts.append(frame.decompress(rest))
        except (zstandard.ZstdError, MemoryError):
            return None
        used += len(rest) - len(frame.unused_data)
        rest = frame.unused_data
        if frame.eof:
            return b"".join(parts), used, rest
        rest = file.read(_CHUNK)
    return None


def _next_frame(file: BinaryIO, at: int) -> int | None:
    """The offset of the next bytes that may begin a frame, at `at` or behind it."""
    file.seek(at)
    buffer = b""
    while chunk := file.read(_CHUNK):
        buffer += chunk
        place = buffer.find(MAGIC)
        if place >= 0:
            return at + place
        known = max(0, len(buffer) - len(MAGIC) + 1)
        at, buffer = at + known, buffer[known:]
    return None
