"""`kb reddit import`: archive dumps → raw envelopes, a task a file, with progress that survives
SIGKILL.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from datetime import datetime
from pathlib import Path

import msgspec

from kb.core import signals
from kb.core.context import Run
from kb.core.engine import make_executor
from kb.core.errors import Interrupted, LimitReached, Stopped
from kb.core.profile.reddit import RedditSection
from kb.core.verdict import Summary
from kb.crawl.session import open_session
from kb.reddit.connector.source import Dumps
from kb.reddit.dumps import cursor as places
from kb.reddit.dumps import files as dumpfiles
from kb.reddit.dumps.containers import memory
from kb.reddit.dumps.cursor import KIND, DumpCursor
from kb.reddit.dumps.import_file import ImportJob, import_file, import_with, name_of
from kb.reddit.parse.anonymize import load_key
from kb.store import mending, rawlog


def import_dumps(
    run: Run, files: Sequence[Path], since: datetime | None = None, until: datetime | None = None
) -> Summary:
    """Import monthly dumps (RS_* posts, RC_* comments), files of one subreddit, or folders of
    dumps, in any container of kb.reddit.dumps.containers. Sends nothing.

    `since` and `until` go by the date of each post and comment. Files that were imported before,
    over the same span, are left out unless `--again`. Raises SettingError (exit 2) when a file
    can't be read, LimitReached and Interrupted (exit 3; the same command goes on), DiskFull.
    """
    section = run.profile.section(RedditSection)
    named = dumpfiles.find(run, files)
    with open_session(run, Dumps(run)) as session:
        load_key(run.root)
        span = (since.timestamp() if since else 0.0, until.timestamp() if until else math.inf)
        root = str(run.root.absolute())
        jobs = [
            ImportJob(root, str(file.absolute()), section.subreddit, *span, run.limit or 0)
            for file in different(run, named.files, span)
        ]
        try:
            found = import_jobs(run, jobs)
            mending.asked_again(session.frontier, imported=run.again)
        finally:
            for path in rawlog.segments(run.root, "reddit", KIND):
                session.frontier.set_offset(KIND, rawlog.base_name(path), path.stat().st_size)
    return Summary(summary_of(found), foreign_files=named.foreign)


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


def import_jobs(run: Run, jobs: list[ImportJob]) -> list[DumpCursor]:
    """Import these files below `run.root`; their places.

    Whatever stops it, what was imported until then is in the error's summary.
    """
    names = [name_of(job) for job in jobs]
    round = places.begin_round(run.root, names) if run.again else ""
    before = [
        places.load(run.root, name, job.file, round).things
        for name, job in zip(names, jobs, strict=True)
    ]

    def now() -> list[DumpCursor]:
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


def _run(run: Run, jobs: list[ImportJob]) -> None:
    done: list[DumpCursor] = []
    # With a limit one file after the other: it counts things over all of them.
    size = sum(Path(job.file).stat().st_size for job in jobs)
    workers = 1 if run.limit else run.processes(size)
    with (
        make_executor(run.engine, workers, run.scheduler) as executor,
        places.lease(run.root) as lease,
        run.progress.task("import", total=len(jobs), unit="files") as task,
    ):
        jobs = [msgspec.structs.replace(job, lease=str(lease.absolute())) for job in jobs]
        most = int(run.settings.kb_import_memory_gb * 1e9)
        if len(jobs) < workers:
            # One after the other, its lines shared out.
            found = _one_by_one(executor, 2 * workers, jobs)
        else:
            window = 1 if run.limit else 2 * workers
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


def _one_by_one(executor: Executor, window: int, jobs: list[ImportJob]) -> Iterator[DumpCursor]:
    """Places of files that all workers read together, as long as the run is not asked to end."""
    for job in jobs:
        if signals.stop.requested():
            return
        yield import_with(executor, window, job)


def _results(
    executor: Executor, tasks: Iterator[tuple[ImportJob]], window: int, most: int
) -> Iterator[DumpCursor]:
    """Places in the order of the jobs. When the run is asked to end, those that have begun are
    still waited for: they end soon.

    Files are handed out while all that are read together take `most` bytes at most, the windows of
    their frames included.
    """
    waiting: deque[tuple[Future[DumpCursor], int]] = deque()
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


def _tasks(jobs: list[ImportJob], done: list[DumpCursor]) -> Iterator[tuple[ImportJob]]:
    """The jobs; with a limit each gets what the ones before it left of it."""
    for job in jobs:
        yield (
            msgspec.structs.replace(job, limit=job.limit - sum(place.fresh for place in done))
            if job.limit
            else job,
        )


def summary_of(found: list[DumpCursor]) -> Summary:
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
