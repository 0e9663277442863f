"""`kb reddit import`: archive dumps → raw envelopes, a task a file, with progress that survives SIGKILL.

Envelopes have the form of a Listing with 100 things, so that the parse of live answers reads them.
A file's place is noted whenever one of its segments is whole; the segment appears by a rename
after the note, and a note whose segment did not get there is completed at the next start.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import LimitReached, SettingError
from kb.core.verdict import Summary
from kb.reddit.authors import Scrubber, load_key
from kb.reddit.dumps import Search, Seen, chunks, retrieved
from kb.reddit.state import apply
from kb.reddit.strip import without
from kb.store import rawlog
from kb.store.atomic import full_disk_is_resumable, sync_folder, write_bytes
from kb.store.frontier import Frontier
from kb.store.identity import remember
from kb.store.lock import writer
from kb.store.rawlog import SEGMENT_BYTES, SUFFIX, Envelope, Request
from kb.store.recorder import Recorder
from kb.store.tombstones import keys as tombstones

KIND = "dumps"
THINGS = 100


class Place(msgspec.Struct):
    """How far a dump was imported. `offset` in decompressed bytes; `segment` the last one noted."""

    file: str
    offset: int = 0
    segments: int = 0
    segment: str = ""
    things: int = 0
    lines: int = 0
    bad_lines: int = 0
    truncated: bool = False
    problem: str = ""
    done: bool = False
    fresh: int = 0  # things of this run


class Job(msgspec.Struct):
    """What a worker needs; plain values."""

    root: str
    file: str
    subreddit: str
    since: float
    until: float
    limit: int
    segment_bytes: int = SEGMENT_BYTES


def import_dumps(run: Run, files: Sequence[Path], since: datetime | None = None, until: datetime | None = None) -> Summary:
    """Import monthly dumps (`RS_*.zst` posts, `RC_*.zst` comments) or files of one subreddit. Sends nothing.

    Files that were imported before are left out unless `--again`. Raises SettingError (exit 2) when
    a file can't be read, LimitReached and Interrupted (exit 3; the same command goes on), DiskFull.
    """
    section = run.profile.section("reddit")
    for file in files:
        _readable(file)
    with writer(run.root, "reddit"):
        remember(run.root, "reddit", subreddit=section.subreddit.lower())
        load_key(run.root)
        frontier = Frontier(run.root / "state" / "reddit.sqlite")
        try:
            Recorder(run.root, "reddit", frontier, apply).close()
            if run.again:
                for file in files:
                    _note(run.root, file).unlink(missing_ok=True)
            jobs = [
                Job(
                    str(run.root.absolute()),
                    str(file.absolute()),
                    section.subreddit,
                    since.timestamp() if since else 0.0,
                    until.timestamp() if until else float("inf"),
                    run.limit or 0,
                )
                for file in files
            ]
            places = _run(run, jobs)
            for path in rawlog.segments(run.root, "reddit", KIND):
                frontier.set_offset(KIND, rawlog.base_name(path), path.stat().st_size)
        finally:
            frontier.close()
    return _summary(places)


def _run(run: Run, jobs: list[Job]) -> list[Place]:
    task = run.progress.task("import", total=len(jobs), unit="files")
    places: list[Place] = []
    before = [_place(Path(job.root), Path(job.file)).things for job in jobs]
    # With a limit one file after the other: it counts things over all of them.
    with make_executor(run.engine, 1 if run.limit else min(run.workers, len(jobs)), run.scheduler) as executor:
        for place in map_in_order(executor, import_file, _tasks(jobs, places), window=1 if run.limit else 2 * run.workers):
            # Not the worker's own count: one that dies after its file is done is replaced by one that finds nothing to do.
            place.fresh = place.things - before[len(places)]
            places.append(place)
            task.advance(1, things=sum(done.things for done in places), bad_lines=sum(done.bad_lines for done in places))
            if place.problem:
                run.progress.say(f"{place.file}: {place.problem} after {place.lines} lines; what came before it was imported")
            if run.limit and sum(done.fresh for done in places) >= run.limit:
                task.close()
                error = LimitReached(f"{run.limit} things were imported (--limit {run.limit})", hint="run the same command to go on")
                error.summary = _summary(places)
                raise error
    task.close()
    return places


def _tasks(jobs: list[Job], places: list[Place]) -> Iterator[tuple[Job]]:
    """The jobs; with a limit each gets what the ones before it left of it."""
    for job in jobs:
        yield (msgspec.structs.replace(job, limit=job.limit - sum(place.fresh for place in places)) if job.limit else job,)


def _summary(places: list[Place]) -> Summary:
    return Summary(
        source="reddit",
        crawled=sum(place.fresh for place in places),
        lines=sum(place.lines for place in places),
        bad_lines=sum(place.bad_lines for place in places),
        truncated_files=sum(place.truncated for place in places),
        requests=0,
    )


def import_file(job: Job) -> Place:
    """Import one dump from where it was left; its place. Runs in a worker; memory is bounded by a chunk."""
    root, file = Path(job.root), Path(job.file)
    place = _place(root, file)
    place.fresh = 0
    if place.done:
        return place
    scrubber, gone = Scrubber(load_key(root)), tombstones(root, "reddit")
    seen = Seen(lines=place.lines, bad_lines=place.bad_lines)
    out = Segments(root, file, place, job.segment_bytes)
    waiting: list[dict[str, Any]] = []
    offset, taken = place.offset, 0
    search = Search(job.subreddit)
    with full_disk_is_resumable(root):
        for chunk in chunks(file, seen, skip=place.offset):
            found = search(chunk)
            wanted = [(end, thing) for end, record in found.records if (thing := _wanted(record, job, gone))]
            room = job.limit - taken if job.limit else len(wanted)
            if job.limit and len(wanted) >= room:
                # Only the part of the chunk up to the last thing taken counts as read.
                wanted = wanted[:room]
                chunk = chunk._replace(end=chunk.begin + wanted[-1][0] - chunk.offset)
                found = search(chunk)
            for _, thing in wanted:
                waiting.append({**thing, "data": scrubber.scrub(thing["data"])})
                if len(waiting) == THINGS:
                    out.write(waiting)
                    waiting = []
            taken += len(wanted)
            offset = chunk.offset + chunk.end - chunk.begin
            seen.lines += found.lines
            seen.bad_lines += found.bad_lines
            if out.full or (job.limit and taken >= job.limit):
                out.write(waiting)
                waiting = []
                out.close(offset, taken, seen)
                if job.limit:
                    return place
                taken = 0
        out.write(waiting)
        place.done, place.truncated, place.problem = True, seen.truncated, seen.problem
        out.close(offset, taken, seen)
    return place


def _wanted(record: dict[str, Any], job: Job, gone: set[str]) -> dict[str, Any] | None:
    """The record as a thing, unless it is out of the span or purged."""
    kind = "t3" if "title" in record else "t1"
    if not job.since <= _made(record) < job.until:
        return None
    left = without([{"kind": kind, "data": record}], gone)
    return left[0] if left else None


class Segments:
    """The segments of one dump; each appears whole."""

    def __init__(self, root: Path, file: Path, place: Place, size: int) -> None:
        self.place = place
        self._root, self._dump, self._most = root, file, size
        self._base = rawlog.folder(root, "reddit", KIND)
        self._base.mkdir(parents=True, exist_ok=True)
        self._engine = zstandard.ZstdCompressor(level=3)
        self._part: Path | None = None
        self._file: Any = None

    @property
    def full(self) -> bool:
        """Whether the segment is large enough to be closed."""
        return self._file is not None and self._file.tell() >= self._most

    def write(self, things: list[dict[str, Any]]) -> None:
        """One envelope, shaped like a Listing."""
        if not things:
            return
        if self._file is None:
            self._part = self._base / f".{_key(self._dump)}.part"
            self._file = self._part.open("wb")
        read = [at for thing in things if (at := retrieved(thing["data"])) is not None]
        envelope = Envelope(
            _stamp(max(read)) if read else None,
            Request(f"dump/{self._dump.name}", {}),
            200,
            {"kind": "Listing", "data": {"children": things, "after": None}},
        )
        self._file.write(self._engine.compress(rawlog.encode(envelope)))

    def close(self, offset: int, things: int, seen: Seen) -> None:
        """Note the place, then let the segment appear."""
        if self._file is not None and self._part is not None:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self.place.segments += 1
            self.place.segment = f"{self.place.segments:06d}-{_key(self._dump)[:8]}{SUFFIX}"
        self.place.offset, self.place.lines, self.place.bad_lines = offset, seen.lines, seen.bad_lines
        self.place.things += things
        self.place.fresh += things
        _note(self._root, self._dump).parent.mkdir(parents=True, exist_ok=True)
        write_bytes(_note(self._root, self._dump), msgspec.json.encode(self.place))
        if self._part is not None:
            os.rename(self._part, self._base / self.place.segment)
            sync_folder(self._base)
        self._file = self._part = None


def _stamp(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _made(record: dict[str, Any]) -> float:
    try:
        return float(record.get("created_utc") or 0)
    except (TypeError, ValueError):
        return 0.0


def _readable(file: Path) -> None:
    try:
        with file.open("rb") as opened:
            start = opened.read(4)
    except OSError as error:
        raise SettingError(f"{file} can't be read: {error.strerror}", hint="give paths of .zst dumps that exist") from None
    if start != b"\x28\xb5\x2f\xfd" and not (len(start) == 4 and start[1:] == b"\x2a\x4d\x18"):
        raise SettingError(f"{file} is no zstd file", hint="give RS_*.zst, RC_*.zst or files of one subreddit")


def _key(file: Path) -> str:
    """Tells a dump by its name, size and beginning, wherever it lies."""
    with file.open("rb") as opened:
        start = opened.read(1 << 16)
    return hashlib.sha256(f"{file.name}\0{file.stat().st_size}\0".encode() + start).hexdigest()[:16]


def _note(root: Path, file: Path) -> Path:
    return root / "state" / "reddit-import" / f"{_key(file)}.json"


def _place(root: Path, file: Path) -> Place:
    """Where the import of a dump was left; completes a rename that was cut off."""
    note = _note(root, file)
    if not note.exists():
        return Place(str(file))
    place = msgspec.json.decode(note.read_bytes(), type=Place)
    base = rawlog.folder(root, "reddit", KIND)
    part = base / f".{_key(file)}.part"
    if place.segment and part.exists() and not (base / place.segment).exists():
        os.rename(part, base / place.segment)
    return place
