"""Which raw answers may hold a key: every byte is read and searched, nothing is decoded."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
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
# What may follow a field's name: a text up to its end or its first escape, a number, a list.
_VALUE = re.compile(rb'[ \t\n\r]*:[ \t\n\r]*(?:"([^"\\]*)(\\?)|(-?[0-9][0-9.eE+-]*)|(\[)|)')
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


def standing(texts: Iterable[str], fields: Iterable[str]) -> Holds:
    """As `finder`, of texts that go only where they are the value of one of these fields, or stand
    there between commas.

    The few names are found four times as fast as many texts.
    """
    wanted = frozenset(msgspec.json.encode(text)[1:-1] for text in texts)
    if not wanted or b"" in wanted:
        return lambda line: bool(wanted)
    marks = sorted({*map(msgspec.json.encode, fields), _ESCAPED})
    find = BytesAhoCorasick(marks).find_matches_as_indexes

    def holds(line: bytes | msgspec.Raw) -> bool:
        data = bytes(line)
        return any(
            marks[number] == _ESCAPED or _may_be(data, end, wanted) for number, _, end in find(data)
        )

    return holds


def _may_be(line: bytes, at: int, wanted: Collection[bytes]) -> bool:
    """Whether the value behind a field's name may be one of the texts; False where the name is
    itself a value.
    """
    value = _VALUE.match(line, at)
    if value is None:
        return False
    text, escape, number, several = value.groups()
    if text is None:
        return bool(several) or (number is not None and (number in wanted or number[:2] == b"-0"))
    return bool(escape) or text in wanted or any(one in wanted for one in text.split(b","))


def _is_alone(line: bytes, start: int, end: int) -> bool:
    if line[start:end] == _ESCAPED:
        return True
    inside = (start and line[start - 1 : start].isalnum()) or line[end : end + 1].isalnum()
    return not inside


def everything(keys: Collection[str]) -> Holds:
    """The same for sources that don't say what stands in an answer with a key."""
    return lambda line: True


def search(
    root: Path,
    source: str,
    holds: Holds,
    threads: int = 1,
    own: Mapping[str, Holds] | None = None,
) -> Found:
    """The frames that may hold a key, of the segments that have any. Changes nothing.

    `own` are raw kinds of which something else tells it than `holds`.

    Nothing that could not be read is passed over: raises DamagedData for the first segment with
    bytes that are no answer, the torn end of an open one apart, and Interrupted.
    """
    paths = rawlog.all_segments(root, source)

    def look(path: Path) -> list[tuple[int, int]]:
        signals.stop.check()
        tells = (own or {}).get(path.parent.name, holds)
        frames = rawlog.Frames(path, checked=True)
        return [(frames.start, end) for end, line in frames if tells(line)]

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
