"""Archive dumps: NDJSON in zstd with a 2^31 window, one line a post or comment, all subreddits mixed or one.

A whole chunk is searched for the subreddit's name before anything is parsed; only lines that hold
it are read as JSON, and looked at again then. Of the others it is seen that they begin and end as
objects do. What is cut off or damaged is counted, never fatal.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import orjson
import zstandard
from ahocorasick_rs import BytesAhoCorasick

# Several passes go over what one read swells to, so it should fit the processor's cache (measured in the bench).
CHUNK = 512 << 10  # decompressed bytes that zstd makes room for
CHECKED = 1 << 20  # decompressed bytes at the beginning of which every line is read
DEEPEST = 200  # levels of nesting; what Reddit says has about ten
_BLOCK = 32 << 10  # compressed bytes of one read; they swell to 10 to 30 times as much


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


def pieces(path: Path, seen: Seen) -> Iterator[bytes]:
    """Decompressed bytes of all frames, a piece for each read of the file.

    A frame that ends early or is damaged sets `seen.truncated`: python-zstandard's stream reader
    would end there without a word, and a plain decompressor after the first frame.
    """
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    frame, fresh = engine.decompressobj(write_size=CHUNK), True
    with path.open("rb") as file:
        rest = file.read(_BLOCK)
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
            rest = rest or file.read(_BLOCK)
    if not fresh:
        seen.truncated, seen.problem = True, "the last frame is cut off"


class Chunk(NamedTuple):
    """Whole lines: data[begin:end], of which the first byte is at `offset` in the decompressed file. A part of a line may follow."""

    offset: int
    data: bytes
    begin: int
    end: int


def chunks(path: Path, seen: Seen, skip: int = 0, goes_on: Callable[[], bool] = lambda: True) -> Iterator[Chunk]:
    """Whole lines from decompressed offset `skip` on; a piece is never copied, the line across two pieces comes by itself.

    A last line without line break is given when the file is whole; in a cut file it is a part of
    a line and counts as damaged. `goes_on` is asked at every piece, also while skipping; when it says
    no, `seen.stopped` is set and nothing more comes.
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
            continue
        if parts:
            begin = piece.find(b"\n") + 1
            line = b"".join((*parts, piece[:begin]))
            yield Chunk(at, line, 0, len(line))
            at += len(line)
        if begin < end:
            yield Chunk(at, piece, begin, end)
            at += end - begin
        held = len(piece) - end
        parts = [piece[end:]] if held else []
    rest = b"".join(parts)
    if rest.strip() and seen.truncated:
        seen.lines += 1
        seen.damaged(1, at)
    elif rest.strip():
        yield Chunk(at, rest + b"\n", 0, len(rest) + 1)


class Found(NamedTuple):
    """What a chunk holds: its lines, damaged ones and where the first is, and the subreddit's records as (offset of the line's end, object)."""

    lines: int
    bad_lines: int
    first_bad: int | None
    records: list[tuple[int, dict[str, Any]]]


class Search:
    """Finds the records of one subreddit in chunks of a dump, however its name is written.

    Every line must begin and end as an object does; one that doesn't is read, and so is every line of
    the first CHECKED bytes and of chunks that are mostly the subreddit's. Elsewhere only lines that
    hold the name are read.
    """

    def __init__(self, subreddit: str) -> None:
        self._name = subreddit.lower()
        self._quoted = f'"{self._name}"'.encode()
        # One pattern: its vectorised search is several times faster than bytes.find, and than many spellings (tests/bench).
        self._places = BytesAhoCorasick([bytes(byte | _CASE for byte in self._quoted)]).find_matches_as_indexes

    def __call__(self, chunk: Chunk) -> Found:
        """What a chunk holds, in order."""
        offset, data, begin, end = chunk
        lines, whole = _counted(chunk)
        stop = begin
        records: list[tuple[int, dict[str, Any]]] = []
        hits: set[int] = set()  # where lines begin that were read
        bad: list[int] = []
        for place in self._found(data, begin, end):
            if place < stop:
                continue  # again in the same line
            first = data.rfind(b"\n", stop, place) + 1 or stop
            stop = data.find(b"\n", place) + 1
            record = _read(data[first:stop])
            hits.add(first)
            if record is None:
                bad.append(first)
            # The name may stand in a title: only the field decides.
            elif str(record.get("subreddit", "")).lower() == self._name:
                records.append((offset + stop - begin, record))
        every = offset < CHECKED or 2 * len(records) >= lines
        if len(hits) < lines and (every or whole < lines):
            at = begin
            for line in _lines(chunk):
                if at not in hits and (every or not _looks_whole(line)) and line.strip() and _read(line) is None:
                    bad.append(at)
                at += len(line)
        return Found(lines, len(bad), offset + min(bad) - begin if bad else None, records)

    def _found(self, data: bytes, begin: int, end: int) -> Iterator[int]:
        """Where the quoted name may stand in data[begin:end], in order, in any case."""
        rest = begin
        if end - begin > _FEW:
            folded = _folded(data)
            for _, place, _ in self._places(folded[begin:end]):
                yield begin + place
            # Folding ends at a multiple of eight bytes: the name may lie across its end.
            rest = max(begin, len(folded) - len(self._quoted) + 1)
        lower = data[rest:end].lower()
        place = lower.find(self._quoted)
        while place >= 0:
            yield rest + place
            place = lower.find(self._quoted, place + 1)


_FEW = 16 << 10  # bytes, in which a plain search has ended before the other one has begun
_CASE = 0x20  # the bit that tells a small letter from a capital


def _folded(data: bytes) -> memoryview:
    """The bytes with capitals as small letters, but for the last seven at most.

    Other bytes change too, so what is found there has to be looked at. Eight at a time are twice as fast as one.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    eights = len(data) // 8
    plain = pa.Array.from_buffers(pa.uint64(), eights, [None, pa.py_buffer(data)])
    return memoryview(pc.call_function("bit_wise_or", [plain, _cases()]).buffers()[1]).cast("B")[: eights * 8]


@cache
def _cases() -> Any:
    import pyarrow as pa

    return pa.scalar(int.from_bytes([_CASE] * 8), pa.uint64())


def _counted(chunk: Chunk) -> tuple[int, int]:
    """How many lines a chunk has, and how many of them begin and end as objects do.

    A file finds line breaks twice as fast as bytes.count, and lines that are let go at once cost no memory.
    """
    file = io.BytesIO(chunk.data)
    file.seek(chunk.begin)
    try:
        whole = [line[0] == 0x7B and line[-2] == 0x7D for line in file]
    except IndexError:  # an empty line, or a part of one
        file.seek(chunk.begin)
        whole = [line[:1] == b"{" and line[-2:] == b"}\n" for line in file]
    if chunk.end < len(chunk.data):
        whole.pop()  # a part of a line
    return len(whole), whole.count(True)


def _lines(chunk: Chunk) -> list[bytes]:
    """The lines of a chunk with their ends (bytes.splitlines would also split at a carriage return)."""
    return io.BytesIO(chunk.data[chunk.begin : chunk.end]).readlines()


def _looks_whole(line: bytes) -> bool:
    line = line.strip()
    return line.startswith(b"{") and line.endswith(b"}")


def _read(line: bytes) -> dict[str, Any] | None:
    """The object of a line, None when it is none, or nested so deeply that reading it could end the run."""
    try:
        value = orjson.loads(line)
    except orjson.JSONDecodeError:
        try:
            # The patient reader takes lone surrogates, which real titles hold.
            value = json.loads(line)
        except (ValueError, RecursionError):
            return None
    return None if not isinstance(value, dict) or _is_deep(line, value) else value


def _is_deep(line: bytes, value: Any) -> bool:
    if line.count(b"[") + line.count(b"{") <= DEEPEST:
        return False
    level = [value]
    for _ in range(DEEPEST):
        inner = (list(outer.values()) if isinstance(outer, dict) else outer for outer in level if isinstance(outer, (dict, list)))
        level = [one for several in inner for one in several]
        if not level:
            return False
    return True


def retrieved(data: dict[str, Any]) -> int | None:
    """When the archive read a record, in seconds since 1970; None when it doesn't say."""
    for name in ("retrieved_utc", "retrieved_on"):
        value = data.get(name)
        if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20:
            value = int(value)
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < 253402300800:
            return int(value)
    return None
