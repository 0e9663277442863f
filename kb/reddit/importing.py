"""`kb reddit import`: archive dumps → raw envelopes, a task a file, with progress that survives
SIGKILL.

Envelopes have the form of a Listing with 100 things, so that the parse of live answers reads them.
A file's place is noted whenever one of its segments is whole, and when the run is asked to end.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from datetime import datetime
from pathlib import Path

import msgspec

from kb.core import signals
from kb.core.context import Run
from kb.core.engine import make_executor
from kb.core.errors import Interrupted, LimitReached, SettingError, Stopped
from kb.core.verdict import Summary
from kb.crawl.session import open_session
from kb.reddit import places
from kb.reddit.authors import load_key
from kb.reddit.dumps import Chunk, Seen, chunks, memory
from kb.reddit.lines import Block, Looked, Rules, Taken, look, look_at_block, rules, search_of
from kb.reddit.places import KIND, Place
from kb.reddit.search import State
from kb.reddit.segments import Segments
from kb.reddit.source import Dumps
from kb.store import mending, rawlog
from kb.store.atomic import full_disk_is_resumable
from kb.store.rawlog import SEGMENT_BYTES

THINGS = 100
BLOCK = 4 << 20  # decompressed bytes that a worker looks at in one go
# Workers take about a second each to start. Before a file has cost as much it is read without them:
# by what looking takes, not by the clock, which says something else each time.
WORTH = 3.0  # seconds of one core
_LOOKED, _TAKEN = 1e9, 12_000  # bytes and things a second


class Job(msgspec.Struct):
    """What a worker needs; plain values. Without a lease nobody can stop it before the
    file's end.

    `ids` is a folder of kb.reddit.byid: these records instead of the subreddit's, or, with a
    subreddit, these of it. `home` is the data root whose key and tombstones count, where `root`
    is a work folder.
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


def import_dumps(
    run: Run, files: Sequence[Path], since: datetime | None = None, until: datetime | None = None
) -> Summary:
    """Import monthly dumps (`RS_*.zst` posts, `RC_*.zst` comments) or files of one subreddit. Sends
    nothing.

    `since` and `until` go by the date of each post and comment. Files that were imported before,
    over the same span, are left out unless `--again`. Raises SettingError (exit 2) when a file
    can't be read, LimitReached and Interrupted (exit 3; the same command goes on), DiskFull.
    """
    section = run.profile.section("reddit")
    check_readable(files)
    with open_session(run, Dumps(run)) as session:
        load_key(run.root)
        span = (since.timestamp() if since else 0.0, until.timestamp() if until else math.inf)
        root = str(run.root.absolute())
        jobs = [
            Job(root, str(file.absolute()), section.subreddit, *span, run.limit or 0)
            for file in different(run, files, span)
        ]
        try:
            found = import_jobs(run, jobs)
            mending.asked_again(session.frontier, imported=run.again)
        finally:
            for path in rawlog.segments(run.root, "reddit", KIND):
                session.frontier.set_offset(KIND, rawlog.base_name(path), path.stat().st_size)
    return summary_of(found)


def different(
    run: Run, files: Sequence[Path], span: tuple[float, float] = (0.0, math.inf)
) -> list[Path]:
    """The files without those that are given twice, under whatever path."""
    named: dict[str, Path] = {}
    for file in files:
        name = places.name_of(file, *span)
        if name in named:
            run.progress.say(f"{file}: the same dump as {named[name]}, read once")
        named.setdefault(name, file)
    return list(named.values())


def import_jobs(run: Run, jobs: list[Job]) -> list[Place]:
    """Import these files below `run.root`; their places.

    Whatever stops it, what was imported until then is in the error's summary.
    """
    names = [_name(job) for job in jobs]
    round = places.begin_round(run.root, names) if run.again else ""
    before = [
        places.load(run.root, name, job.file, round).things
        for name, job in zip(names, jobs, strict=True)
    ]

    def now() -> list[Place]:
        """From the notes, not the workers' own counts: one that dies after its file is done is
        replaced by one that finds nothing to do.
        """
        noted = [
            places.load(run.root, name, job.file, round)
            for name, job in zip(names, jobs, strict=True)
        ]
        return [
            msgspec.structs.replace(place, fresh=place.things - had)
            for place, had in zip(noted, before, strict=True)
        ]

    todo = []
    for name, job in zip(names, jobs, strict=True):
        place = places.load(run.root, name, job.file, round)
        if place.done:
            run.progress.say(
                f"{job.file}: imported before ({place.things} posts and comments); --again"
                " reads it once more"
            )
        else:
            todo.append(msgspec.structs.replace(job, round=round))
    try:
        if todo:
            _run(run, todo)
    except Stopped as error:
        error.summary = summary_of(now())
        raise
    if run.again:
        places.end_round(run.root)
    return now()


def _run(run: Run, jobs: list[Job]) -> None:
    done: list[Place] = []
    # With a limit one file after the other: it counts things over all of them.
    workers = 1 if run.limit else run.workers
    with (
        make_executor(run.engine, workers, run.scheduler) as executor,
        places.lease(run.root) as lease,
        run.progress.task("import", total=len(jobs), unit="files") as task,
    ):
        jobs = [msgspec.structs.replace(job, lease=str(lease.absolute())) for job in jobs]
        most = int(run.settings.kb_import_memory_gb * 1e9)
        if len(jobs) < run.workers and not run.limit:
            # Fewer files than workers: one after the other, its lines shared out.
            found = _one_by_one(executor, 2 * run.workers, jobs)
        else:
            window = 1 if run.limit else 2 * run.workers
            found = _results(executor, _tasks(jobs, done), window, most)
        for place in found:
            done.append(place)
            task.advance(
                1,
                posts_and_comments=sum(one.fresh for one in done),
                bad_lines=sum(one.bad_lines for one in done),
            )
            if place.problem:
                run.progress.say(
                    f"{place.file}: {place.problem} after {place.lines} lines; what came"
                    " before it was imported"
                )
            if place.bad_lines:
                run.progress.say(
                    f"{place.file}: left out {place.bad_lines} damaged lines, the first at"
                    f" byte {place.first_bad} when decompressed"
                )
            if run.limit and sum(one.fresh for one in done) >= run.limit:
                raise LimitReached(
                    f"{run.limit} posts and comments were imported (--limit {run.limit})",
                    hint="run the same command to go on",
                )
        if len(done) < len(jobs) or not all(place.done for place in done):
            raise Interrupted(
                f"stopped by {signals.stop.name or 'a signal'}",
                hint="run the same command to go on",
            )


def _one_by_one(executor: Executor, window: int, jobs: list[Job]) -> Iterator[Place]:
    """Places of files that all workers read together, as long as the run is not asked to end."""
    for job in jobs:
        if signals.stop.requested():
            return
        yield import_with(executor, window, job)


def _results(
    executor: Executor, tasks: Iterator[tuple[Job]], window: int, most: int
) -> Iterator[Place]:
    """Places in the order of the jobs. When the run is asked to end, those that have begun are
    still waited for: they end soon.

    Files are handed out while all that are read together take `most` bytes at most, the windows of
    their frames included.
    """
    waiting: deque[tuple[Future[Place], int]] = deque()
    for task in tasks:
        need = memory(Path(task[0].file))
        while waiting and sum(taken for _, taken in waiting) + need > most:
            yield waiting.popleft()[0].result()
        if signals.stop.requested():
            break
        waiting.append((executor.submit(import_file, *task), need))
        if len(waiting) >= window:
            yield waiting.popleft()[0].result()
    while waiting:
        yield waiting.popleft()[0].result()


def _tasks(jobs: list[Job], done: list[Place]) -> Iterator[tuple[Job]]:
    """The jobs; with a limit each gets what the ones before it left of it."""
    for job in jobs:
        yield (
            msgspec.structs.replace(job, limit=job.limit - sum(place.fresh for place in done))
            if job.limit
            else job,
        )


def summary_of(found: list[Place]) -> Summary:
    """What an import did, by the places of its files."""
    return Summary(
        command="reddit import",
        source="reddit",
        counted="posts and comments",
        crawled=sum(place.fresh for place in found),
        lines=sum(place.lines for place in found),
        bad_lines=sum(place.bad_lines for place in found),
        truncated_files=sum(place.truncated for place in found),
        requests=0,
    )


def import_file(job: Job) -> Place:
    """Import one dump from where it was left; its place. Runs in a worker; memory is bounded by a
    chunk.
    """
    return _write(job, lambda place, seen: _in_turn(job, place, seen))


def import_with(executor: Executor, window: int, job: Job) -> Place:
    """The same with the lines looked at by the workers of `executor`, `window` blocks in hand."""
    return _write(job, lambda place, seen: _side_by_side(executor, window, job, place, seen))


def _write(job: Job, read: Callable[[Place, Seen], Iterator[Looked]]) -> Place:
    root, file, name = Path(job.root), Path(job.file), _name(job)
    place = places.load(root, name, job.file, job.round)
    places.complete(rawlog.folder(root, "reddit", KIND), place)
    place.fresh = 0
    if place.done:
        return place
    seen = Seen(place.lines, place.bad_lines, place.first_bad)
    out = Segments(root, file, name, place, job.segment_bytes)
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


def _chunks(job: Job, place: Place, seen: Seen) -> Iterator[Chunk]:
    leased = not job.lease
    return chunks(Path(job.file), seen, place.offset, lambda: leased or Path(job.lease).exists())


def _rules(job: Job) -> Rules:
    home = Path(job.home or job.root)
    return rules(home, job.subreddit, job.since, job.until, job.ids)


def _in_turn(job: Job, place: Place, seen: Seen) -> Iterator[Looked]:
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
    executor: Executor, window: int, job: Job, place: Place, seen: Seen
) -> Iterator[Looked]:
    """What is in the chunks, in their order, as one worker after the other would find it.

    The first blocks, of which most is learned, are looked at here. The others are with what the
    search knew when they were handed out; where a block before it taught the search something, one
    is looked at again.
    """
    wanted, state, spent = _rules(job), State((), True), 0.0
    waiting: deque[tuple[Block, State, Future[tuple[list[Looked], State]]]] = deque()

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


def _name(job: Job) -> str:
    return places.name_of(Path(job.file), job.since, job.until)


def check_readable(files: Sequence[Path]) -> None:
    """Raise SettingError for what is no dump, before anything is read."""
    for file in files:
        _readable(file)


def _readable(file: Path) -> None:
    try:
        with file.open("rb") as opened:
            start = opened.read(4)
    except OSError as error:
        raise SettingError(
            f"{file} can't be read: {error.strerror}", hint="give paths of .zst dumps that exist"
        ) from None
    if start != b"\x28\xb5\x2f\xfd" and not (len(start) == 4 and start[1:] == b"\x2a\x4d\x18"):
        raise SettingError(
            f"{file} is no zstd file", hint="give RS_*.zst, RC_*.zst or files of one subreddit"
        )
