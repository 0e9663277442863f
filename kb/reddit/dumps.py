"""Archive dumps: NDJSON in zstd with a 2^31 window, one line a post or comment, all subreddits mixed or one.

A whole chunk is searched for the subreddit's name before anything is parsed; only lines that hold
it are read as JSON, and looked at again then. What is cut off or damaged is counted, never fatal.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import orjson
import zstandard
from ahocorasick_rs import BytesAhoCorasick

# Several passes go over what one read swells to, so it should fit the processor's cache (measured in the bench).
CHUNK = 512 << 10  # decompressed bytes that zstd makes room for
CHECKED = 8 << 20  # decompressed bytes at the beginning of which every line is looked at
_BLOCK = 16 << 10  # compressed bytes of one read; they swell to 10 to 30 times as much


@dataclass
class Seen:
    """What reading a dump met, so far."""

    lines: int = 0
    bad_lines: int = 0
    truncated: bool = False
    problem: str = ""


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
    """Whole lines: data[begin:end], of which the first byte is at `offset` in the decompressed file."""

    offset: int
    data: bytes
    begin: int
    end: int


def chunks(path: Path, seen: Seen, skip: int = 0) -> Iterator[Chunk]:
    """Whole lines from decompressed offset `skip` on; a piece is never copied, the line across two pieces comes by itself.

    A last line without line break is given when the file is whole; in a cut file it is a part of
    a line and counts as damaged.
    """
    parts: list[bytes] = []  # a line that goes on in the next piece
    held = 0  # their bytes
    at = 0  # of the next byte to give
    for piece in pieces(path, seen):
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
        seen.bad_lines += 1
    elif rest.strip():
        yield Chunk(at, rest + b"\n", 0, len(rest) + 1)


class Found(NamedTuple):
    """What a chunk holds: its lines, damaged ones, and the subreddit's records as (offset of the line's end, object)."""

    lines: int
    bad_lines: int
    records: list[tuple[int, dict[str, Any]]]


class Search:
    """Finds the records of one subreddit in chunks of a dump.

    The name is looked for without case until a record shows how the archive writes it. Every line
    of the first CHECKED bytes, and of chunks that are mostly the subreddit's, must be an object;
    elsewhere only lines that hold the name are read, and can be found damaged.
    """

    def __init__(self, subreddit: str) -> None:
        self._name = subreddit.lower()
        self._exact = False
        self._look_for(self._name)

    def _look_for(self, name: str) -> None:
        self._needle = b'"' + name.encode() + b'"'
        # One pattern: its vectorised search is several times faster than bytes.find (tests/bench).
        self._places = BytesAhoCorasick([self._needle]).find_matches_as_indexes

    def __call__(self, chunk: Chunk) -> Found:
        """What a chunk holds, in order."""
        offset, data, begin, end = chunk
        lines, bad, stop = _lines(chunk), 0, begin
        whole = memoryview(data if self._exact else data.lower())[begin:end]
        records: list[tuple[int, dict[str, Any]]] = []
        for _, place, _ in self._places(whole):
            if begin + place < stop:
                continue  # again in the same line
            first = data.rfind(b"\n", stop, begin + place) + 1 or stop
            stop = data.find(b"\n", begin + place) + 1
            record = _read(data[first:stop])
            if record is None:
                bad += 1
            # The name may stand in a title: only the field decides.
            elif isinstance(record, dict) and str(record.get("subreddit", "")).lower() == self._name:
                records.append((offset + stop - begin, record))
        if offset < CHECKED or 2 * len(records) > lines:
            bad += self._damaged(data[begin:end], lines)
        if records and not self._exact:
            self._exact = True
            self._look_for(records[0][1]["subreddit"])
        return Found(lines, bad, records)

    def _damaged(self, data: bytes, lines: int) -> int:
        """Lines that are no objects; those with the name were counted where they were read."""
        if data.count(b"}\n{") == lines - 1 and data.startswith(b"{") and data.endswith(b"}\n"):
            return 0
        return sum(
            1 for line in data.splitlines() if line.strip() and self._needle not in (line if self._exact else line.lower()) and not _whole(line)
        )


def _lines(chunk: Chunk) -> int:
    """How many lines a chunk has; a file's search for line breaks is twice as fast as bytes.count."""
    file = io.BytesIO(chunk.data)
    file.seek(chunk.begin)
    return sum(1 for _ in file) - (chunk.end < len(chunk.data))


def _read(line: bytes) -> Any:
    """The object of a line, None when it is none."""
    try:
        return orjson.loads(line)
    except orjson.JSONDecodeError:
        pass
    try:
        # The patient reader takes lone surrogates, which real titles hold.
        return json.loads(line)
    except ValueError:
        return None


def _whole(line: bytes) -> bool:
    line = line.strip()
    return line.startswith(b"{") and line.endswith(b"}")


def retrieved(data: dict[str, Any]) -> int | None:
    """When the archive read a record, in seconds since 1970; None when it doesn't say."""
    for name in ("retrieved_utc", "retrieved_on"):
        value = data.get(name)
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < 253402300800:
            return int(value)
        if isinstance(value, str) and value.isdigit():
            return int(value)
    return None
