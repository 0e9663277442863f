"""One dump → raw segments: from where it was left, by one worker or with its lines shared out.

Envelopes have the form of a Listing with 100 things, so that the parse of live answers reads them.
A file's place is noted whenever one of its segments is whole, and when the run is asked to end.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path

import msgspec

from kb.reddit.dumps import cursor as places
from kb.reddit.dumps.chunks import Chunk, chunks
from kb.reddit.dumps.containers import Seen
from kb.reddit.dumps.cursor import KIND, DumpCursor
from kb.reddit.dumps.extract import (
    Block,
    Looked,
    RecordRules,
    Taken,
    look,
    look_at_block,
    rules,
    search_of,
)
from kb.reddit.dumps.segments import DumpSegments
from kb.reddit.dumps.subreddit_search import SearchState
from kb.store import rawlog
from kb.store.atomic import full_disk_is_resumable
from kb.store.rawlog import SEGMENT_BYTES

THINGS = 100
BLOCK = 4 << 20  # decompressed bytes that a worker looks at in one go
# Workers take about a second each to start. Before a file has cost as much it is read without them:
# by what looking takes, not by the clock, which says something else each time.
WORTH = 3.0  # seconds of one core
_LOOKED, _TAKEN = 1e9, 12_000  # bytes and things a second


class ImportJob(msgspec.Struct):
    """What a worker needs; plain values. Without a lease nobody can stop it before the
    file's end.

    `ids` is a folder of kb.reddit.dumps.id_search: these records instead of the subreddit's, or,
    with a subreddit, these of it. `home` is the data root whose key and tombstones count, where
    `root` is a work folder.
    """

    root: str
    file: str
    subreddit: str
    since: float
    until: float
    limit: int
    segment_bytes: int = SEGMENT_BYTES
    round: str = ""
    lease: str = ""
    ids: str = ""
    home: str = ""


def import_file(job: ImportJob) -> DumpCursor:
    """Import one dump from where it was left; its place. Runs in a worker; memory is bounded by a
    chunk.
    """
    return _write(job, lambda place, seen: _in_turn(job, place, seen))


def import_with(executor: Executor, window: int, job: ImportJob) -> DumpCursor:
    """The same with the lines looked at by the workers of `executor`, `window` blocks in hand."""
    return _write(job, lambda place, seen: _side_by_side(executor, window, job, place, seen))


def _write(job: ImportJob, read: Callable[[DumpCursor, Seen], Iterator[Looked]]) -> DumpCursor:
    root, file, name = Path(job.root), Path(job.file), name_of(job)
    place = places.load(root, name, job.file, job.round)
    places.complete(rawlog.folder(root, "reddit", KIND), place)
    place.fresh = 0
    if place.done:
        return place
    seen = Seen(place.lines, place.bad_lines, place.first_bad)
    out = DumpSegments(root, file, name, place, job.segment_bytes)
    waiting: list[Taken] = []
    offset, taken = place.offset, 0
    with full_disk_is_resumable(root):
        for found in read(place, seen):
            for thing in found.things:
                waiting.append(thing)
                if len(waiting) == THINGS:
                    out.write(waiting, thing.end)
                    waiting = []
            taken += len(found.things)
            offset = found.offset
            seen.lines += found.lines
            seen.damaged(found.bad_lines, found.first_bad)
            enough = bool(job.limit) and taken >= job.limit
            if out.full or enough:
                out.write(waiting, offset)
                waiting = []
                out.close(offset, taken, seen)
                if job.limit:
                    return place
                taken = 0
        out.write(waiting, offset)
        place.truncated, place.problem = seen.truncated, seen.problem
        if not seen.stopped:
            places.ended(place, file)
        out.close(offset, taken, seen)
    return place


def _chunks(job: ImportJob, place: DumpCursor, seen: Seen) -> Iterator[Chunk]:
    leased = not job.lease
    return chunks(Path(job.file), seen, place.offset, lambda: leased or Path(job.lease).exists())


def _rules(job: ImportJob) -> RecordRules:
    home = Path(job.home or job.root)
    return rules(home, job.subreddit, job.since, job.until, job.ids)


def _in_turn(job: ImportJob, place: DumpCursor, seen: Seen) -> Iterator[Looked]:
    wanted, room = _rules(job), job.limit
    search = search_of(wanted)
    for chunk in _chunks(job, place, seen):
        found = look(search, chunk, wanted)
        if job.limit and len(found.things) >= room:
            # Only the part of the chunk up to the last thing taken counts as read.
            size = found.things[room - 1].end - chunk.offset
            part = chunk.data[chunk.begin : chunk.begin + size]
            found = look(search, Chunk(chunk.offset, part, 0, size), wanted)
        room -= len(found.things)
        yield found


def _side_by_side(
    executor: Executor, window: int, job: ImportJob, place: DumpCursor, seen: Seen
) -> Iterator[Looked]:
    """What is in the chunks, in their order, as one worker after the other would find it.

    The first blocks, of which most is learned, are looked at here. The others are with what the
    search knew when they were handed out; where a block before it taught the search something, one
    is looked at again.
    """
    wanted, state, spent = _rules(job), SearchState((), True), 0.0
    waiting: deque[tuple[Block, SearchState, Future[tuple[list[Looked], SearchState]]]] = deque()

    def next_found() -> list[Looked]:
        nonlocal state
        block, knew, future = waiting.popleft()
        if knew != state:
            future = executor.submit(look_at_block, block, wanted, state)
        found, state = future.result()
        return found

    for block in _blocks(_chunks(job, place, seen)):
        if spent <= WORTH:
            found, state = look_at_block(block, wanted, state)
            size, things = (
                sum(len(data) for _, data in block),
                sum(len(one.things) for one in found),
            )
            spent += size / _LOOKED + things / _TAKEN
            yield from found
            continue
        waiting.append((block, state, executor.submit(look_at_block, block, wanted, state)))
        if len(waiting) >= window:
            yield from next_found()
    while waiting:
        yield from next_found()


def _blocks(found: Iterable[Chunk]) -> Iterator[Block]:
    """Chunks together, some MB each, so that handing them out costs little."""
    block: list[tuple[int, bytes]] = []
    size = 0
    for chunk in found:
        block.append((chunk.offset, chunk.data[chunk.begin : chunk.end]))
        size += chunk.end - chunk.begin
        if size >= BLOCK:
            yield tuple(block)
            block, size = [], 0
    if block:
        yield tuple(block)


def name_of(job: ImportJob) -> str:
    """The name of the note of its place."""
    return places.name_of(Path(job.file), job.since, job.until)
