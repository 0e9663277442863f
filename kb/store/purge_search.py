"""Which raw answers may hold a key: every byte is read and searched, nothing is decoded."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path

import msgspec
from ahocorasick_rs import BytesAhoCorasick, Implementation

from kb.core import signals
from kb.core.engine import make_threads
from kb.store import rawlog
from kb.store.frames import content

Holds = Callable[["bytes | msgspec.Raw"], bool]
Found = dict[Path, list[tuple[int, int]]]
"""Of each segment the frames (start, end) that may hold a key, in order."""

_ESCAPED = b"\\u"
_LARGE = 1 << 16  # bytes of all keys: a table of so many states takes some dozens of MiB


def finder(texts: Iterable[str], *, alone: bool = False) -> Holds:
    """A function that says whether a raw line may hold one of these texts in some string or number.

    Never False for a line that does; looking is many times cheaper than decoding. Lines are
    searched as `rawlog.encode` writes them; one with an escaped character may hold anything. With
    `alone` a text between other letters or digits doesn't count: short ids are parts of many words.
    """
    needles = {msgspec.json.encode(text)[1:-1] for text in texts}
    if not needles or b"" in needles:
        return lambda line: bool(needles)
    # Three times as fast as what the library takes by itself for more than a hundred texts.
    quick = Implementation.DFA if sum(map(len, needles)) < _LARGE else None
    find = BytesAhoCorasick(
        sorted({*needles, _ESCAPED}), implementation=quick
    ).find_matches_as_indexes
    if not alone:
        return lambda line: bool(find(line))

    def holds(line: bytes | msgspec.Raw) -> bool:
        if not find(line):
            return False
        data = bytes(line)
        return any(_is_alone(data, start, end) for _, start, end in find(data, overlapping=True))

    return holds


def _is_alone(line: bytes, start: int, end: int) -> bool:
    if line[start:end] == _ESCAPED:
        return True
    inside = (start and line[start - 1 : start].isalnum()) or line[end : end + 1].isalnum()
    return not inside


def everything(keys: Collection[str]) -> Holds:
    """The same for sources that don't say what stands in an answer with a key."""
    return lambda line: True


def search(root: Path, source: str, holds: Holds, threads: int = 1) -> Found:
    """The frames that may hold a key, of the segments that have any. Changes nothing.

    Nothing that could not be read is passed over: raises DamagedData for the first segment with
    bytes that are no answer, the torn end of an open one apart, and Interrupted.
    """
    paths = [
        path for kind in rawlog.kinds(root, source) for path in rawlog.segments(root, source, kind)
    ]

    def look(path: Path) -> list[tuple[int, int]]:
        signals.stop.check()
        frames = rawlog.Frames(path, checked=True)
        return [(frames.start, end) for end, line in frames if holds(line)]

    # Decompressing and searching let other threads run.
    with make_threads(threads) as pool:
        found = dict(zip(paths, pool.map(look, paths), strict=True))
    return {path: places for path, places in found.items() if places}


def lines(path: Path, places: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int, bytes]]:
    """(start, end, line) of these frames of a segment. Nobody else may write it."""
    with path.open("rb") as file:
        for start, end in places:
            file.seek(start)
            yield start, end, content(file.read(end - start))
