"""`kb reddit import`: archive dumps → raw envelopes, one task per file, resumable after SIGKILL."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from datetime import datetime
from pathlib import Path

import msgspec

from kb.core import clock, signals
from kb.core.context import Run
from kb.core.engine import make_executor
from kb.core.errors import Interrupted, LimitReached, Stopped
from kb.core.summary import Summary
from kb.crawl.job import remember_import
from kb.crawl.session import open_session
from kb.reddit.crawl.subreddit import Subreddit
from kb.reddit.dumps.cursor import (
    KIND,
    DumpCursor,
    begin_round,
    end_round,
    lease,
    load_cursor,
)
from kb.reddit.dumps.files import memory
from kb.reddit.dumps.find_dumps import find_dumps
from kb.reddit.dumps.import_file import ImportJob, import_file
from kb.reddit.dumps.known_dumps import KnownDumps
from kb.reddit.parse.anonymize import load_key
from kb.reddit.section import RedditSection
from kb.store.rawlog import rawlog


def import_dumps(
    run: Run, files: Sequence[Path], since: datetime | None = None, until: datetime | None = None
) -> Summary:
    """Import monthly dumps (RS_* posts, RC_* comments), files of one subreddit, or folders of
    dumps, in any container of kb.reddit.dumps.files. Sends nothing.

    `since` and `until` bound the dates of posts and comments. Files that were imported before with
    the same span are skipped unless `--again`. Raises SettingError (exit 2) for a file that can't
    be read, LimitReached and Interrupted (exit 3; the same command resumes), DiskFull.
    """
    section = run.profile.section(RedditSection)
    dumps = find_dumps(run, files)
    with open_session(run, Subreddit(run)) as session:
        load_key(run.root)
        job = ImportJob(
            root=str(run.root.absolute()),
            file="",
            subreddit=section.subreddit,
            since=since.timestamp() if since else 0.0,
            until=until.timestamp() if until else math.inf,
            limit=run.limit or 0,
        )
        try:
            summary = import_files(run, job, dumps.files)
            if run.again:
                session.frontier.forget_lost(KIND)
        finally:
            for path in rawlog.segments(run.root, "reddit", KIND):
                session.frontier.set_offset(KIND, rawlog.base_name(path), path.stat().st_size)
        span = {
            "since": [clock.stamp(since)] if since else [],
            "until": [clock.stamp(until)] if until else [],
        }
        remember_import(session.frontier, files=files, **span)
    return Summary(summary, foreign_files=dumps.foreign)


def import_files(run: Run, job: ImportJob, files: Sequence[Path]) -> Summary:
    """Import these files below `run.root`, each as `job` says; a file given twice is read once.

    The summary of an error has what was imported until then.
    """
    known = KnownDumps(run, job.since, job.until)
    for file in files:
        if (twin := known.take(file)) is not None:
            run.progress.say(f"{file}: same dump as {twin.file}, read once")
    jobs = {
        name: msgspec.structs.replace(job, file=dump.file, note=name, sha256=dump.sha256)
        for name, dump in known.taken.items()
    }
    if run.again:
        begin_round(run.root, jobs)

    def cursors() -> list[DumpCursor]:
        """As noted on disk: a worker that dies after its file is done is replaced by one that has
        nothing to do.
        """
        return [load_cursor(run.root, name, own.file) for name, own in jobs.items()]

    before = cursors()

    def summary() -> Summary:
        now = cursors()
        return Summary(
            command="reddit import",
            source="reddit",
            counted="posts and comments",
            crawled=sum(cursor.things for cursor in now) - sum(cursor.things for cursor in before),
            lines=sum(cursor.lines for cursor in now),
            bad_lines=sum(cursor.bad_lines for cursor in now),
            truncated_files=sum(cursor.truncated for cursor in now),
            requests=0,
        )

    todo = []
    for cursor, waiting in zip(before, jobs.values(), strict=True):
        if cursor.done:
            run.progress.say(
                f"{waiting.file}: already imported ({cursor.things} posts and comments); --again"
                " imports it again"
            )
        else:
            todo.append(waiting)
    try:
        if todo:
            _import(run, todo)
    except Stopped as error:
        error.summary = summary()
        raise
    if run.again:
        end_round(run.root)
    return summary()


def _import(run: Run, jobs: list[ImportJob]) -> None:
    """Import files side by side, each in one process. With a limit they are read in order, as it
    counts records of all files.
    """
    size = sum(Path(job.file).stat().st_size for job in jobs)
    workers = 1 if run.limit else min(run.processes(size), len(jobs))
    done: list[DumpCursor] = []
    with (
        make_executor(run.engine, workers, run.scheduler, run.root) as executor,
        lease(run.root) as leased,
        run.progress.task("import", total=len(jobs), unit="files") as task,
    ):
        jobs = [msgspec.structs.replace(job, lease=str(leased.absolute())) for job in jobs]
        if run.limit:
            results = _in_sequence(jobs)
        else:
            most = int(run.settings.kb_import_memory_gb * 1e9)
            results = _side_by_side(jobs, executor, executor.window, most)
        for cursor in results:
            done.append(cursor)
            fresh = sum(cursor.fresh for cursor in done)
            bad_lines = sum(cursor.bad_lines for cursor in done)
            task.advance(1, posts_and_comments=fresh, bad_lines=bad_lines)
            if cursor.problem:
                run.progress.say(
                    f"{cursor.file}: {cursor.problem}; the {cursor.lines} lines before it were"
                    " imported"
                )
            if cursor.bad_lines:
                run.progress.say(
                    f"{cursor.file}: skipped {cursor.bad_lines} damaged lines, the first at byte"
                    f" {cursor.first_bad} of the decompressed file"
                )
            if run.limit and fresh >= run.limit:
                raise LimitReached(
                    f"imported {run.limit} posts and comments (--limit {run.limit})",
                    hint="run the same command to resume",
                )
        if len(done) < len(jobs) or not all(cursor.done for cursor in done):
            raise Interrupted(
                f"stopped by {signals.stop.name or 'a signal'}",
                hint="run the same command to resume",
            )


def _in_sequence(jobs: list[ImportJob]) -> Iterator[DumpCursor]:
    """Cursors of files that are read one after the other, until the run is asked to stop."""
    limit = jobs[0].limit
    for job in jobs:
        if signals.stop.requested():
            return
        cursor = import_file(msgspec.structs.replace(job, limit=limit))
        limit -= cursor.fresh if limit else 0
        yield cursor


def _side_by_side(
    jobs: list[ImportJob], executor: Executor, window: int, most: int
) -> Iterator[DumpCursor]:
    """Cursors in the order of the jobs. When the run is asked to stop, running jobs end soon and
    are waited for.

    Running jobs together take at most `most` bytes, including the windows of their frames.
    """
    waiting: deque[tuple[Future[DumpCursor], int]] = deque()
    for job in jobs:
        need = memory(Path(job.file))
        while waiting and sum(taken for _, taken in waiting) + need > most:
            yield waiting.popleft()[0].result()
        if signals.stop.requested():
            break
        waiting.append((executor.submit(import_file, job), need))
        if len(waiting) >= window:
            yield waiting.popleft()[0].result()
    while waiting:
        yield waiting.popleft()[0].result()
