"""Archive dumps: NDJSON in zstd with a 2^31 window, one line a post or comment, all subreddits
mixed or one.

A file comes as chunks of whole lines (kb.reddit.search looks into them). What is cut off or damaged
is counted, never fatal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard

from kb.core.errors import SettingError

# Several passes go over what one read swells to, so it should fit the processor's cache (measured
# in the bench).
CHUNK = 512 << 10  # decompressed bytes that zstd makes room for
_PIECE = 32 << 10  # compressed bytes of one go; they swell to 10 to 30 times as much
_BLOCKS = 16  # of zstd in one go at most: a block swells to 128 KiB, whatever its size
LATEST = 253402300800  # seconds of Unix time: the year 10000
LONGEST = 64 << 20  # bytes of a line; Reddit's longest records have some hundred thousand


_FRAME, _SKIPPED, _REPEATED = b"\x28\xb5\x2f\xfd", b"\x2a\x4d\x18", 1

_HEAD = 18  # bytes of the longest header of a frame
_ASIDE = 32 << 20  # bytes of what a chunk swells to


@dataclass
class Seen:
    """What reading a dump met, so far."""

    lines: int = 0
    bad_lines: int = 0
    first_bad: int | None = None  # offset of the first of them in the decompressed file
    truncated: bool = False
    problem: str = ""
    stopped: bool = False  # asked to, before the end

    def damaged(self, number: int, first: int | None) -> None:
        """Count damaged lines, the first of which begins at `first`."""
        self.bad_lines += number
        if self.first_bad is None:
            self.first_bad = first


def check_readable(files: Sequence[Path]) -> None:
    """Raise SettingError for what is no dump, before anything is read."""
    for file in files:
        _readable(file)


def _readable(file: Path) -> None:
    try:
        with file.open("rb") as opened:
            start = opened.read(4)
    except OSError as error:
        raise SettingError(
            f"{file} can't be read: {error.strerror}", hint="give paths of .zst dumps that exist"
        ) from None
    if start != _FRAME and not (len(start) == 4 and start[1:] == _SKIPPED):
        raise SettingError(
            f"{file} is no zstd file", hint="give RS_*.zst, RC_*.zst or files of one subreddit"
        )


def pieces(path: Path, seen: Seen) -> Iterator[bytes]:
    """Decompressed bytes of all frames, a piece for each read of the file.

    A frame that ends early or is damaged sets `seen.truncated`: python-zstandard's stream reader
    would end there without a word, and a plain decompressor after the first frame.
    """
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    frame, fresh = engine.decompressobj(write_size=CHUNK), True
    with path.open("rb", buffering=1 << 20) as file:
        for rest in _compressed(file):
            while rest:
                try:
                    data = frame.decompress(rest)
                except zstandard.ZstdError as error:
                    seen.truncated, seen.problem = True, f"damaged frame: {error}"
                    return
                fresh = False
                if data:
                    yield data
                rest = frame.unused_data if frame.eof else b""
                if frame.eof:
                    frame, fresh = engine.decompressobj(write_size=CHUNK), True
    if not fresh:
        seen.truncated, seen.problem = True, "the last frame is cut off"


def _compressed(file: BinaryIO) -> Iterator[bytes]:
    """The file in pieces of a few blocks: one of a single letter swells 30,000 times, and the
    decompressor gives all at once.

    What is no zstd comes as it is, for the decompressor to say so.
    Source: https://www.rfc-editor.org/rfc/rfc8878#section-3.1
    """
    while head := file.read(4):
        if head[1:] == _SKIPPED:
            left = file.read(4)
            yield head + left
            end = file.tell() + int.from_bytes(left, "little")
            while piece := file.read(min(_PIECE, end - file.tell())):
                yield piece
            continue
        if head != _FRAME:
            yield head
            while piece := file.read(_PIECE):
                yield piece
            return
        described = file.read(1)
        flags = described[0] if described else 0
        single, checksum = flags >> 5 & 1, 4 * (flags >> 2 & 1)
        size = (1 - single) + (0, 1, 2, 4)[flags & 3] + (single, 2, 4, 8)[flags >> 6]
        yield head + described + file.read(size)
        head = file.read(3)
        waiting, held = [head], 0
        while len(head) == 3:
            block = int.from_bytes(head, "little")
            size = 1 if block >> 1 & 3 == _REPEATED else block >> 3
            # The head of the next block comes along: one call for both, and no copy of a large one.
            body = file.read(size + (checksum if block & 1 else 3))
            waiting.append(body)
            held += size
            if block & 1:
                break
            if held >= _PIECE or len(waiting) == _BLOCKS:
                yield body if len(waiting) == 1 else b"".join(waiting)
                waiting, held = [], 0
            head = body[-3:]
        yield b"".join(waiting)


def memory(path: Path) -> int:
    """Bytes that reading a dump takes: its first frame's window (2 GiB in the archives' files), and
    what a chunk of it swells to.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
        while head[1:4] == _SKIPPED and len(head) >= 8:
            file.seek(int.from_bytes(head[4:8], "little") - len(head) + 8, 1)
            head = file.read(_HEAD)
    try:
        window = zstandard.get_frame_parameters(head).window_size
    except zstandard.ZstdError:
        window = 0
    return int(window) + _ASIDE


class Chunk(NamedTuple):
    """Whole lines: data[begin:end], of which the first byte is at `offset` in the decompressed
    file. A part of a line may follow.
    """

    offset: int
    data: bytes
    begin: int
    end: int


def chunks(
    path: Path, seen: Seen, skip: int = 0, goes_on: Callable[[], bool] = lambda: True
) -> Iterator[Chunk]:
    """Whole lines from decompressed offset `skip` on; a piece is never copied, the line across two
    pieces comes by itself.

    A last line without line break is given when the file is whole; in a cut file it is a part of
    a line and counts as damaged, as does one of more than `LONGEST` bytes, of which nothing is
    held. `goes_on` is asked at every piece, also while skipping; when it
    says no, `seen.stopped` is set and nothing more comes.
    """
    parts: list[bytes] = []  # a line that goes on in the next piece
    held = 0  # their bytes
    at = 0  # of the next byte to give
    for piece in pieces(path, seen):
        if not goes_on():
            seen.stopped = True
            return
        begin = max(0, skip - at - held)
        if begin:
            # Only the part of the piece from `skip` on is wanted; what was held lies before it.
            at, parts, held = at + held + min(begin, len(piece)), [], 0
        end = piece.rfind(b"\n", begin) + 1
        if end <= begin:
            parts.append(piece[begin:])
            held += len(parts[-1])
            if held > LONGEST:
                parts = []
            continue
        if held:
            begin = piece.find(b"\n") + 1
            size = held + begin
            if size > LONGEST:
                seen.lines += 1
                seen.damaged(1, at)
                yield Chunk(at + size, b"", 0, 0)  # so far all is read
            else:
                yield Chunk(at, b"".join((*parts, piece[:begin])), 0, size)
            at += size
        if begin < end:
            yield Chunk(at, piece, begin, end)
            at += end - begin
        held = len(piece) - end
        parts = [piece[end:]] if held else []
    rest = b"".join(parts)
    if held > LONGEST or (rest.strip() and seen.truncated):
        seen.lines += 1
        seen.damaged(1, at)
    elif rest.strip():
        yield Chunk(at, rest + b"\n", 0, len(rest) + 1)


def retrieved(data: dict[str, Any]) -> int | None:
    """When the archive read a record, in seconds since 1970; None when it doesn't say."""
    for name in ("retrieved_utc", "retrieved_on"):
        value = data.get(name)
        if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20:
            value = int(value)
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < LATEST:
            return int(value)
    return None
