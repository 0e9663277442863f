"""Records in chunks of a dump: of one subreddit, or by their ids.

A whole chunk is searched before anything is parsed. Only lines with a hit are parsed as JSON and
checked; of the others only the first and last characters are checked.

Ids are opaque: membership of a set decides, never their order. Where all ids are of one subreddit,
its lines are found as an import finds them and the id decides; else every line is parsed.
"""

import io
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import accumulate, chain, product
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
from ahocorasick_rs import BytesAhoCorasick, MatchKind

from kb.reddit.dumps.files import Chunk, read_object, records_of
from kb.reddit.parse import answer_tree
from kb.schema.decode import in_batches
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


class SubredditSearch:
    """Finds the records of one subreddit in chunks of a dump, however its name is written.

    Lines with the name are parsed, as are lines that do not begin and end like an object, every
    line of the first CHECKED bytes, and every line of chunks that are mostly of the subreddit.
    """

    def __init__(self, subreddit: str) -> None:
        self._name = subreddit.lower()
        self._quoted = f'"{self._name}"'.encode()
        patterns = [*_spellings(self._quoted), *_UNUSED]
        search = BytesAhoCorasick(patterns, MatchKind.LeftmostFirst)
        self._beginnings = search.find_matches_as_indexes

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
                if data[first:stop].strip():
                    bad.append(first)
                continue
            wanted = [thing for thing in records_of(record) if self._takes(thing)]
            taken += bool(wanted)
            for thing in wanted:
                take(offset + stop - begin, thing)
        every = offset < CHECKED or 2 * taken >= lines
        if len(hits) < lines and (every or well_formed < lines):
            at = begin
            # bytes.splitlines would also split at a carriage return
            for line in io.BytesIO(data[begin:end]).readlines():
                text = line.strip()
                suspect = every or not (text.startswith(b"{") and text.endswith(b"}"))
                if text and suspect and at not in hits and read_object(line) is None:
                    bad.append(at)
                at += len(line)
        return ChunkMatches(lines, len(bad), offset + min(bad) - begin if bad else None)

    def _takes(self, record: dict[str, Any]) -> bool:
        """Whether a record is wanted. A title may contain the name: only the field decides."""
        return str(record.get("subreddit", "")).lower() == self._name

    def _positions(self, data: bytes, begin: int, end: int) -> Iterable[int]:
        """Positions in data[begin:end] at which the quoted name is, in order."""
        for _, place, _ in self._beginnings(memoryview(data)[begin:end]):
            at = begin + place
            if data[at : at + len(self._quoted)].lower() == self._quoted:
                yield at


# Several patterns are searched for at once, sixteen bytes or more at a time, at most 32 of them,
# and only if they begin with different bytes: else every quotation mark would be looked at.
_UNUSED = [bytes([control]) * 4 for control in range(3)]
_LETTERS = 4  # of a name that are searched for in both cases


def _spellings(quoted: bytes) -> Iterator[bytes]:
    """How the beginning of a quoted name may be spelled."""
    cases = [sorted({byte, *bytes([byte]).upper()}) for byte in quoted]
    letters = list(accumulate(len(both) > 1 for both in cases))
    return map(bytes, product(*cases[: bisect_right(letters, _LETTERS)]))


def _counted(chunk: Chunk) -> tuple[int, int]:
    """How many lines a chunk has, and how many of them begin and end like an object.

    Iterating over a file finds line breaks several times as fast as bytes.count, and needs memory
    for one line only.
    """
    file = io.BytesIO(chunk.data)
    file.seek(chunk.begin)
    brace = ord("{")
    well_formed = [
        line[0] == brace and (line[-2:] == b"}\n" or line[-3:] == b"}\r\n") for line in file
    ]
    if chunk.end < len(chunk.data):
        well_formed.pop()  # a part of a line
    return len(well_formed), well_formed.count(True)


TREE = "tree_"  # before the bare id of a post that is wanted with all comments
_WANTED, _GONE = "wanted.arrow", "gone"


def write_index(
    names: Iterable[str], trees: Iterable[str], folder: Path, purged: Collection[str] = ()
) -> None:
    """Write full names, and bare ids of posts wanted with all comments, for `ById`.

    Names in `purged` are not wanted.
    """
    wanted = (name for name in chain(names, map(TREE.__add__, trees)) if name not in purged)
    parts = [pa.array(part, pa.string()) for part in in_batches(wanted, 1 << 16)]
    column = pc.unique(pa.chunked_array(parts, pa.string()))
    rows = pa.table({"name": column.take(pc.sort_indices(column))})
    with replacing_folder(folder) as fresh:
        with pa.ipc.new_file(str(fresh / _WANTED), rows.schema) as file:
            file.write_table(rows)
        write_bytes(fresh / _GONE, "".join(f"{name}\n" for name in sorted(purged)).encode())


class IdIndex:
    """What `write_index` wrote into `folder`; processes share the memory of its sorted names."""

    def __init__(self, folder: Path) -> None:
        with pa.ipc.open_file(pa.memory_map(str(folder / _WANTED))) as file:
            self._names: Any = file.read_all()["name"].combine_chunks()
        self.purged = frozenset((folder / _GONE).read_text().splitlines())

    def __contains__(self, name: str) -> bool:
        at = bisect_left(self._names, name, key=lambda value: value.as_py())
        return at < len(self._names) and bool(self._names[at].as_py() == name)


class ById(SubredditSearch):
    """Finds posts and comments by id in chunks of a dump, and the comments of some posts.

    With a `subreddit` only its lines are searched, as for an import; without one every line is
    parsed.
    """

    def __init__(self, kept: IdIndex, subreddit: str = "") -> None:
        super().__init__(subreddit)
        self._kept = kept

    def _positions(self, data: bytes, begin: int, end: int) -> Iterable[int]:
        if self._name:
            yield from super()._positions(data, begin, end)
            return
        while begin < end:
            yield begin
            begin = data.find(b"\n", begin) + 1

    def _takes(self, record: dict[str, Any]) -> bool:
        if self._name and not super()._takes(record):
            return False
        key = record.get("id")
        if not isinstance(key, str):
            return False
        if "title" in record:
            return f"t3_{key}" in self._kept or f"{TREE}{key}" in self._kept
        post = answer_tree.bare(record.get("link_id"))
        return f"t1_{key}" in self._kept or f"{TREE}{post}" in self._kept
