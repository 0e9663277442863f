"""Archive dumps: NDJSON in zstd with a 2^31 window, one line a post or comment, all subreddits mixed or one.

A whole chunk is searched for the subreddit's name before anything is parsed; only lines that hold
it are read as JSON, and looked at again then. What is cut off or damaged is counted, never fatal.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import orjson
import zstandard

# Several passes go over a chunk, so it should fit the processor's cache (measured in the bench).
CHUNK = 512 << 10       # decompressed bytes looked at in one go
CHECKED = 8 << 20      # decompressed bytes at the beginning of which every line is looked at
_BLOCK = 64 << 10       # compressed bytes; mostly swell to one chunk


@dataclass
class Seen:
    """What reading a dump met, so far."""

    lines: int = 0
    bad_lines: int = 0
    truncated: bool = False
    problem: str = ""


def pieces(path: Path, seen: Seen) -> Iterator[bytes]:
    """Decompressed bytes of all frames, in pieces of at least CHUNK (the last may be smaller).

    A frame that ends early or is damaged sets `seen.truncated`: python-zstandard's stream reader
    would end there without a word, and a plain decompressor after the first frame.
    """
    engine = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    frame, fresh = engine.decompressobj(write_size=CHUNK), True
    held: list[bytes] = []
    size = 0
    with path.open("rb") as file:
        rest = file.read(_BLOCK)
        while rest:
            try:
                data = frame.decompress(rest)
            except zstandard.ZstdError as error:
                seen.truncated, seen.problem = True, f"damaged frame: {error}"
                break
            fresh = False
            held.append(data)
            size += len(data)
            rest = frame.unused_data if frame.eof else b""
            if frame.eof:
                frame, fresh = engine.decompressobj(write_size=CHUNK), True
            rest = rest or file.read(_BLOCK)
            if size >= CHUNK:
                yield b"".join(held)
                held, size = [], 0
    if not fresh and not seen.truncated:
        seen.truncated, seen.problem = True, "the last frame is cut off"
    if held:
        yield b"".join(held)


def chunks(path: Path, seen: Seen, skip: int = 0) -> Iterator[tuple[int, bytes]]:
    """(offset, whole lines) from decompressed offset `skip` on, about CHUNK bytes each.

    A last line without line break is given when the file is whole; in a cut file it is a part of
    a line and counts as damaged.
    """
    rest = b""
    at = 0
    for piece in pieces(path, seen):
        if at + len(rest) + len(piece) <= skip:
            at += len(rest) + len(piece)
            rest = b""
            continue
        chunk = rest + piece
        if at < skip:
            chunk, at = chunk[skip - at :], skip
        end = chunk.rfind(b"\n") + 1
        rest = chunk[end:]
        if end:
            yield at, chunk[:end]
        at += end
    if rest.strip() and seen.truncated:
        seen.lines += 1
        seen.bad_lines += 1
    elif rest.strip():
        yield at, rest + b"\n"


class Found(NamedTuple):
    """What a chunk holds: its lines, damaged ones, and the subreddit's records as (end in the chunk, object)."""

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
        self._folded = b'"' + self._name.encode() + b'"'
        self._exact = b""

    def __call__(self, chunk: bytes, start: int) -> Found:
        """What a chunk of whole lines at decompressed offset `start` holds, in order."""
        text, needle = (chunk, self._exact) if self._exact else (chunk.lower(), self._folded)
        lines, bad = chunk.count(b"\n"), 0
        records: list[tuple[int, dict[str, Any]]] = []
        place = text.find(needle)
        while place >= 0:
            end = chunk.find(b"\n", place)
            record = _read(chunk[chunk.rfind(b"\n", 0, place) + 1 : end])
            if record is None:
                bad += 1
            # The name may stand in a title: only the field decides.
            elif isinstance(record, dict) and str(record.get("subreddit", "")).lower() == self._name:
                records.append((end + 1, record))
            place = text.find(needle, end)
        if start < CHECKED or 2 * len(records) > lines:
            bad += self._damaged(chunk, lines, needle, text is chunk)
        if records and not self._exact:
            self._exact = b'"' + records[0][1]["subreddit"].encode() + b'"'
        return Found(lines, bad, records)

    def _damaged(self, chunk: bytes, lines: int, needle: bytes, exact: bool) -> int:
        """Lines that are no objects; those with the name were counted where they were read."""
        if chunk.count(b"}\n{") == lines - 1 and chunk.startswith(b"{") and chunk.endswith(b"}\n"):
            return 0
        return sum(1 for line in chunk.splitlines() if line.strip() and needle not in (line if exact else line.lower()) and not _whole(line))


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
