"""`kb reddit import`: archive dumps → raw envelopes, a task a file, with progress that survives
SIGKILL.

Envelopes have the form of a Listing with 100 things, so that the parse of live answers reads them.
A file's place is noted whenever one of its segments is whole, and when the run is asked to end.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from kb.core import signals
from kb.core.context import Run
from kb.core.engine import make_executor
from kb.core.errors import Interrupted, LimitReached, SettingError, Stopped
from kb.core.verdict import Summary
from kb.crawl.session import open_session
from kb.reddit import places
from kb.reddit.authors import Scrubber, load_key
from kb.reddit.byid import ById
from kb.reddit.dumps import Chunk, Seen, chunks
from kb.reddit.places import KIND, Place
from kb.reddit.search import Search
from kb.reddit.segments import Segments
from kb.reddit.source import Dumps
from kb.reddit.strip import without
from kb.store import mending, rawlog
from kb.store.atomic import full_disk_is_resumable
from kb.store.rawlog import SEGMENT_BYTES
from kb.store.tombstones import keys as tombstones

THINGS = 100


class Job(msgspec.Struct):
    """What a worker needs; plain values. Without a lease nobody can stop it before the
    file's end.

    `ids` is a folder of kb.reddit.byid: these records instead of the subreddit's. `home` is the
    data root whose key and tombstones count, where `root` is a work folder.
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
    before = [places.load(run.root, name, round=round).things for name in names]

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
    workers = 1 if run.limit else min(run.workers, len(jobs))
    with (
        make_executor(run.engine, workers, run.scheduler) as executor,
        places.lease(run.root) as lease,
        run.progress.task("import", total=len(jobs), unit="files") as task,
    ):
        jobs = [msgspec.structs.replace(job, lease=str(lease.absolute())) for job in jobs]
        for place in _results(
            executor, _tasks(jobs, done), window=1 if run.limit else 2 * run.workers
        ):
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


def _results(executor: Executor, tasks: Iterator[tuple[Job]], window: int) -> Iterator[Place]:
    """Places in the order of the jobs. When the run is asked to end, those that have begun are
    still waited for: they end soon.
    """
    waiting: deque[Future[Place]] = deque()
    for task in tasks:
        if signals.stop.requested():
            break
        waiting.append(executor.submit(import_file, *task))
        if len(waiting) >= window:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


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
    root, file, name = Path(job.root), Path(job.file), _name(job)
    place = places.load(root, name, job.file, job.round)
    places.complete(rawlog.folder(root, "reddit", KIND), place)
    place.fresh = 0
    if place.done:
        return place
    home = Path(job.home or job.root)
    scrubber, gone = Scrubber(load_key(home)), tombstones(home, "reddit")
    seen = Seen(place.lines, place.bad_lines, place.first_bad)
    out = Segments(root, file, name, place, job.segment_bytes)
    waiting: list[dict[str, Any]] = []
    offset, taken = place.offset, 0
    search = Search(job.subreddit)
    if job.ids:
        search = ids = ById(Path(job.ids))
        gone |= ids.gone
    with full_disk_is_resumable(root):
        for chunk in chunks(
            file, seen, place.offset, lambda: not job.lease or Path(job.lease).exists()
        ):
            found = search(chunk)
            wanted = [
                (end, thing)
                for end, record in found.records
                if (thing := _wanted(record, job, gone))
            ]
            room = job.limit - taken if job.limit else len(wanted)
            if job.limit and len(wanted) >= room:
                # Only the part of the chunk up to the last thing taken counts as read.
                wanted = wanted[:room]
                size = wanted[-1][0] - chunk.offset
                chunk = Chunk(chunk.offset, chunk.data[chunk.begin : chunk.begin + size], 0, size)
                found = search(chunk)
            for end, thing in wanted:
                waiting.append({**thing, "data": scrubber.scrub(thing["data"])})
                if len(waiting) == THINGS:
                    out.write(waiting, end)
                    waiting = []
            taken += len(wanted)
            offset = chunk.offset + chunk.end - chunk.begin
            seen.lines += found.lines
            seen.damaged(found.bad_lines, found.first_bad)
            if out.full or (job.limit and taken >= job.limit):
                out.write(waiting, offset)
                waiting = []
                out.close(offset, taken, seen)
                if job.limit:
                    return place
                taken = 0
        out.write(waiting, offset)
        place.done, place.truncated, place.problem = not seen.stopped, seen.truncated, seen.problem
        out.close(offset, taken, seen)
    return place


def _wanted(record: dict[str, Any], job: Job, gone: set[str]) -> dict[str, Any] | None:
    """The record as a thing, unless it is out of the span or purged. One whose date can't be read
    is left to the filter.
    """
    kind = "t3" if "title" in record else "t1"
    at = _made(record)
    if at is not None and not job.since <= at < job.until:
        return None
    left = without([{"kind": kind, "data": record}], gone)
    return left[0] if left else None


def _name(job: Job) -> str:
    return places.name_of(Path(job.file), job.since, job.until)


def _made(record: dict[str, Any]) -> float | None:
    """When a record was made, in seconds since 1970; None when it doesn't say so."""
    try:
        at = float(record.get("created_utc"))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return at if 0 <= at < 253402300800 else None


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
