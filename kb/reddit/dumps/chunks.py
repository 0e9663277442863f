"""Archive dumps as lines: a post or comment each, all subreddits mixed or one.

A file comes as chunks of whole lines, whatever container it is (kb.reddit.dumps.containers);
kb.reddit.dumps.subreddit_search looks into them. What is cut off or damaged is counted, never
fatal.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import orjson

from kb.reddit.dumps.containers import ReadProgress, pieces

DEEPEST = 200  # nested lists and objects; Reddit's records have about ten levels
LONGEST = 64 << 20  # bytes of a line; Reddit's longest records have some hundred thousand


class Chunk(NamedTuple):
    """Whole lines: data[begin:end], of which the first byte is at `offset` in the decompressed
    file. A part of a line may follow.
    """

    offset: int
    data: bytes
    begin: int
    end: int


def chunks(
    path: Path, progress: ReadProgress, skip: int = 0, goes_on: Callable[[], bool] = lambda: True
) -> Iterator[Chunk]:
    """Whole lines from decompressed offset `skip` on. Pieces are not copied; a line across two
    pieces is a chunk of its own.

    A last line without a line break is yielded if it is an object; otherwise the file is truncated
    and the line counts as damaged. A line of more than `LONGEST` bytes counts as damaged too and is
    not kept in memory. `goes_on` is called for every piece, also while skipping; when it returns
    false, `progress.stopped` is set and the iteration ends.
    """
    parts: list[bytes] = []  # a line that goes on in the next piece
    waiting = 0  # their bytes
    at = 0  # of the next byte to give
    for piece in pieces(path, progress):
        if not goes_on():
            progress.stopped = True
            return
        begin = max(0, skip - at - waiting)
        if begin:
            # Only the part of the piece from `skip` on is wanted; earlier parts lie before it.
            at, parts, waiting = at + waiting + min(begin, len(piece)), [], 0
        end = piece.rfind(b"\n", begin) + 1
        if end <= begin:
            parts.append(piece[begin:])
            waiting += len(parts[-1])
            if waiting > LONGEST:
                parts = []
            continue
        if waiting:
            begin = piece.find(b"\n") + 1
            size = waiting + begin
            if size > LONGEST:
                progress.lines += 1
                progress.count_damaged(1, at)
                yield Chunk(at + size, b"", 0, 0)  # everything up to here is read
            else:
                yield Chunk(at, b"".join((*parts, piece[:begin])), 0, size)
            at += size
        if begin < end:
            yield Chunk(at, piece, begin, end)
            at += end - begin
        waiting = len(piece) - end
        parts = [piece[end:]] if waiting else []
    rest = b"".join(parts)
    if waiting <= LONGEST and not rest.strip():
        return
    if read_object(rest) is not None:
        yield Chunk(at, rest + b"\n", 0, len(rest) + 1)
        return
    if not progress.truncated:
        progress.truncated, progress.problem = True, "the last line is cut off"
    progress.lines += 1
    progress.count_damaged(1, at)


def read_object(line: bytes) -> dict[str, Any] | None:
    """The object of a line; None when it is not an object, or nested so deeply that parsing could
    crash the process.
    """
    try:
        value = orjson.loads(line)
    except orjson.JSONDecodeError:
        try:
            # The standard library accepts lone surrogates, which real titles contain, and a byte
            # order mark.
            value = json.loads(line)
        except (ValueError, RecursionError):
            return None
    if not isinstance(value, dict):
        return None
    # Few brackets can't be nested deep, and counting them is quick.
    brackets = line.count(b"[") + line.count(b"{")
    return None if brackets > DEEPEST and _is_deeper(value, DEEPEST) else value


def _is_deeper(value: Any, levels: int) -> bool:
    """Whether more than `levels` lists and objects stand within each other; without recursion."""
    level = [value] if isinstance(value, (dict, list)) else []
    for _ in range(levels):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, (dict, list))
        ]
        if not level:
            return False
    return bool(level)
