"""Records in chunks of a dump: of one subreddit, or by their ids.

A whole chunk is searched before anything is parsed. Only lines with a hit are parsed as JSON and
checked; of the others only the first and last characters are checked.

Ids are opaque: membership of a set decides, never their order. The checksum of the value behind
every `"id":` is looked up in a table of bits, then the id itself; only lines with a wanted id are
parsed. Where all ids are of one subreddit, its lines are found as an import finds them, at the same
rate, and the id decides.

    ids/posts, comments, trees      sorted numbers of eight bytes, one an id
    ids/long                        ids that are longer, one a line
    ids/gone                        purged full names, which are never extracted
    ids/bits                        a bit for each checksum; at most one of 32 is set
"""

import io
import mmap
from array import array
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import pyarrow as pa
import pyarrow.compute as pc
from ahocorasick_rs import BytesAhoCorasick

from kb.reddit.dumps.files import Chunk, read_object
from kb.reddit.parse import answer_tree
from kb.store.atomic import replacing_folder, write_bytes

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


SIZE = 8  # bytes of an id that fits into a number; Reddit's have seven
POSTS, COMMENTS, TREES = "posts", "comments", "trees"
_OF = {answer_tree.POST: POSTS, answer_tree.COMMENT: COMMENTS}
_LONG, _GONE, _BITS = "long", "gone", "bits"
_FEWEST, _MOST = 20, 32  # the table's size as a power of two; a checksum has 32 bits


def write_index(
    names: Iterable[str], trees: Iterable[str], folder: Path, purged: Collection[str] = ()
) -> None:
    """Write full names, and bare ids of posts wanted with all comments, for `ById`.

    Names in `purged` are not wanted.
    """
    numbers = {kind: array("Q") for kind in (POSTS, COMMENTS, TREES)}
    sums, long = array("L"), set()
    for name in chain(names, (f"{TREES}_{key}" for key in trees)):
        if name in purged:
            continue
        prefix, _, key = name.partition("_")
        kind, value = _OF.get(prefix, TREES), key.encode()
        sums.append(crc32(value))
        if len(value) > SIZE:
            long.add(f"{kind} {key}")
        else:
            numbers[kind].append(int.from_bytes(value, "big"))
    width = min(_MOST, max(_FEWEST, (32 * len(sums)).bit_length()))
    bits = bytearray(1 << (width - 3))
    for one in sums:
        at = one >> (32 - width)
        bits[at >> 3] |= 1 << (at & 7)
    with replacing_folder(folder) as fresh:
        for kind, values in numbers.items():
            write_bytes(fresh / kind, array("Q", sorted(set(values))).tobytes())
        write_bytes(fresh / _LONG, "".join(f"{line}\n" for line in sorted(long)).encode())
        write_bytes(fresh / _GONE, "".join(f"{name}\n" for name in sorted(purged)).encode())
        write_bytes(fresh / _BITS, bytes(bits))


class IdIndex:
    """What `write_index` wrote into `folder`; processes share the memory of most of it."""

    def __init__(self, folder: Path) -> None:
        self._sorted = {kind: _numbers(folder / kind) for kind in (POSTS, COMMENTS, TREES)}
        self._long = frozenset((folder / _LONG).read_text().splitlines())
        self.purged = frozenset((folder / _GONE).read_text().splitlines())
        self.bits = _mapped(folder / _BITS)
        self.shift = 32 - (8 * len(self.bits) - 1).bit_length()
        self.trees = bool(self._sorted[TREES]) or any(line.startswith(TREES) for line in self._long)

    def has(self, kind: str, value: bytes) -> bool:
        """Whether an id is wanted as one of POSTS, COMMENTS or TREES."""
        if len(value) > SIZE:
            return f"{kind} {value.decode('utf-8', 'replace')}" in self._long
        number, among = int.from_bytes(value, "big"), self._sorted[kind]
        at = bisect_left(among, number)
        return at < len(among) and among[at] == number


class ById(SubredditSearch):
    """Finds posts and comments by id in chunks of a dump, and the comments of some posts.

    With a `subreddit` only its lines are searched.
    """

    def __init__(self, kept: IdIndex, subreddit: str = "") -> None:
        super().__init__(subreddit)
        self._kept, self._has = kept, kept.has
        self._ids = finder(b'"id":')
        self._links = finder(b'"link_id":') if kept.trees else None

    def _positions(self, data: bytes, begin: int, end: int) -> Iterable[int]:
        return super()._positions(data, begin, end) if self._name else self._any(data, begin, end)

    def _any(self, data: bytes, begin: int, end: int) -> Iterator[int]:
        """Positions of wanted ids of any subreddit, in order."""
        part = memoryview(data)[begin:end]
        hits = self._hits(data, begin, self._ids(part), 0, (POSTS, COMMENTS, TREES))
        if self._links is not None:
            hits += self._hits(data, begin, self._links(part), len("t3_"), (TREES,))
            hits.sort()
        yield from hits

    def _hits(
        self, data: bytes, begin: int, positions: Any, prefix: int, kinds: Sequence[str]
    ) -> list[int]:
        """Positions of wanted ids among the values behind colons, without their first `prefix`
        bytes.

        The loop runs for every line, so it calls few functions.
        """
        bits, shift, find = self._kept.bits, self._kept.shift, data.find
        hits = []
        for _, _, colon in positions:
            at = begin + colon + 1 + prefix
            if data[at - 1 - prefix] == 0x20:  # a space behind the colon
                at += 1
            value = data[at : find(b'"', at)]
            sum_ = crc32(value) >> shift
            if bits[sum_ >> 3] >> (sum_ & 7) & 1 and any(self._has(kind, value) for kind in kinds):
                hits.append(at)
        return hits

    def _takes(self, record: dict[str, Any]) -> bool:
        if self._name and not super()._takes(record):
            return False
        key = record.get("id")
        if not isinstance(key, str):
            return False
        own = key.encode("utf-8", "replace")
        if "title" in record:
            return self._has(POSTS, own) or self._has(TREES, own)
        post = answer_tree.bare(record.get("link_id")).encode("utf-8", "replace")
        return self._has(COMMENTS, own) or self._has(TREES, post)


def _numbers(path: Path) -> Sequence[int]:
    return memoryview(_mapped(path)).cast("Q")


def _mapped(path: Path) -> mmap.mmap | bytes:
    """A file's bytes, in memory that processes share."""
    if not path.stat().st_size:
        return b""
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
