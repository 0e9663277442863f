"""One subreddit's records in chunks of a dump.

A whole chunk is searched before anything is parsed. Only lines with a hit are parsed as JSON and
checked; of the others only the first and last characters are checked.
"""

import io
from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
from ahocorasick_rs import BytesAhoCorasick

from kb.reddit.dumps.chunks import Chunk, read_object

CHECKED = 1 << 20  # decompressed bytes at the beginning in which every line is parsed


class ChunkMatches(NamedTuple):
    """What a chunk holds: its lines, damaged ones and where the first is."""

    lines: int
    bad_lines: int
    first_bad: int | None


Take = Callable[[int, dict[str, Any]], None]
"""Called with the offset behind a record's line and the record. One record at a time: many at once
do not fit the processor's cache, which costs as much as parsing them.
"""


Finder = Callable[[bytes | memoryview], list[tuple[int, int, int]]]


class SubredditSearch:
    """Finds the records of one subreddit in chunks of a dump, however its name is written.

    Lines with the name are parsed, as are lines that do not begin and end like an object, every
    line of the first CHECKED bytes, and every line of chunks that are mostly of the subreddit.
    """

    def __init__(self, subreddit: str) -> None:
        self._name = subreddit.lower()
        self._quoted = f'"{self._name}"'.encode()
        self._folded = finder(bytes(byte | _CASE for byte in self._quoted))

    def __call__(self, chunk: Chunk, take: Take) -> ChunkMatches:
        """What a chunk holds; its records are given to `take`, in order."""
        offset, data, begin, end = chunk
        lines, well_formed = _counted(chunk)
        stop = begin
        taken = 0
        hits: set[int] = set()  # where lines begin that were read
        bad: list[int] = []
        for place in self._positions(data, begin, end):
            if place < stop:
                continue  # a second hit in the same line
            first = data.rfind(b"\n", stop, place) + 1 or stop
            stop = data.find(b"\n", place) + 1
            record = read_object(data[first:stop])
            hits.add(first)
            if record is None:
                bad.append(first)
            elif self._takes(record):
                taken += 1
                take(offset + stop - begin, record)
        every = offset < CHECKED or 2 * taken >= lines
        if len(hits) < lines and (every or well_formed < lines):
            at = begin
            for line in _lines(chunk):
                if (
                    at not in hits
                    and (every or not _is_object_like(line))
                    and line.strip()
                    and read_object(line) is None
                ):
                    bad.append(at)
                at += len(line)
        return ChunkMatches(lines, len(bad), offset + min(bad) - begin if bad else None)

    def _takes(self, record: dict[str, Any]) -> bool:
        """Whether a record is wanted. A title may contain the name: only the field decides."""
        return str(record.get("subreddit", "")).lower() == self._name

    def _positions(self, data: bytes, begin: int, end: int) -> Iterable[int]:
        """Positions in data[begin:end] at which the quoted name is, in order."""
        rest = begin
        if end - begin > _FEW:
            folded = _folded(data)
            for _, place, _ in self._folded(folded[begin:end]):
                yield begin + place
            # Folding ends at a multiple of eight bytes: the name may lie across its end.
            rest = max(begin, len(folded) - len(self._quoted) + 1)
        lower = data[rest:end].lower()
        place = lower.find(self._quoted)
        while place >= 0:
            yield rest + place
            place = lower.find(self._quoted, place + 1)


@lru_cache(maxsize=64)
def finder(text: bytes) -> Finder:
    """A search for one pattern, which is vectorized: several times faster than bytes.find."""
    return BytesAhoCorasick([text]).find_matches_as_indexes


_FEW = 16 << 10  # bytes that a plain search finishes faster than the vectorized one starts
_CASE = 0x20  # the bit that distinguishes lower from upper case


def _folded(data: bytes) -> memoryview:
    """The bytes in lower case, without the last seven at most.

    Other bytes change too, so every hit has to be checked. Eight bytes at a time are twice as fast
    as one.
    """
    eights = len(data) // 8
    plain = pa.Array.from_buffers(pa.uint64(), eights, [None, pa.py_buffer(data)])
    return memoryview(pc.call_function("bit_wise_or", [plain, _cases()]).buffers()[1]).cast("B")[
        : eights * 8
    ]


@cache
def _cases() -> Any:
    return pa.scalar(int.from_bytes([_CASE] * 8), pa.uint64())


def _counted(chunk: Chunk) -> tuple[int, int]:
    """How many lines a chunk has, and how many of them begin and end like an object.

    Iterating over a file finds line breaks twice as fast as bytes.count, and needs memory for one
    line only.
    """
    file = io.BytesIO(chunk.data)
    file.seek(chunk.begin)
    well_formed = [
        line[:1] == b"{" and (line[-2:] == b"}\n" or line[-3:] == b"}\r\n") for line in file
    ]
    if chunk.end < len(chunk.data):
        well_formed.pop()  # a part of a line
    return len(well_formed), well_formed.count(True)


def _lines(chunk: Chunk) -> list[bytes]:
    """The lines of a chunk with their ends (bytes.splitlines would also split at a carriage
    return).
    """
    return io.BytesIO(chunk.data[chunk.begin : chunk.end]).readlines()


def _is_object_like(line: bytes) -> bool:
    line = line.strip()
    return line.startswith(b"{") and line.endswith(b"}")
