"""One dump → raw segments, from where the last import of it stopped.

One process reads a dump from its first line to its last: handing its lines to others costs more
than they save. Wanted records are anonymized and kept as JSON. An envelope has the form of a
Listing with 100 things, so that the reader of live answers reads it. The cursor is saved whenever a
segment is complete, and when the run is asked to stop.
"""

import hashlib
import os
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kb.reddit.dumps.cursor import (
    KIND,
    DumpCursor,
    hidden,
    load_cursor,
    publish_segment,
    save_cursor,
)
from kb.reddit.dumps.files import Chunk, ReadProgress, chunks
from kb.reddit.dumps.known_dumps import note_name, samples_of
from kb.reddit.dumps.search import ById, ChunkMatches, IdIndex, SubredditSearch
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.reddit.parse.answer_tree import PURGED
from kb.reddit.parse.removal import LATEST, retrieved
from kb.reddit.parse.remove_ids import without
from kb.schema.decode import holdable
from kb.store.exhausted import full_disk_is_resumable
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import SEGMENT_BYTES, SUFFIX, Envelope, Request
from kb.store.state import tombstones


class ImportJob(msgspec.Struct):
    """What a worker needs; plain values. Without a lease nobody can stop it before the end of the
    file.

    `ids` is a folder of kb.reddit.dumps.search: these records instead of the subreddit's, or,
    with a subreddit, these of it. `home` is the data root whose key and tombstones count, where
    `root` is a work folder. `note` is the name of the dump's note where it is not this very file's
    own, `sha256` the file's digest where it is known.
    """

    root: str
    file: str
    subreddit: str
    since: float
    until: float
    limit: int
    segment_bytes: int = SEGMENT_BYTES
    lease: str = ""
    ids: str = ""
    home: str = ""
    note: str = ""
    sha256: str = ""


class ExtractedRecord(NamedTuple):
    """A post or comment: the offset behind its line, its JSON, and when the archive read it last
    (Unix time).
    """

    end: int
    line: bytes
    retrieved: int | None


def _extract(
    chunk: Chunk,
    job: ImportJob,
    search: SubredditSearch,
    scrubber: Scrubber,
    purged: Collection[str],
) -> tuple[list[ExtractedRecord], ChunkMatches]:
    """The wanted records of a chunk, and the counts of its lines."""
    records: list[ExtractedRecord] = []

    def take(end: int, record: dict[str, Any]) -> None:
        if not _in_span(record, job):
            return
        kind = "t3" if "title" in record else "t1"
        data = scrubber.scrub(record)
        things = [{"kind": kind, "data": data}]
        if purged or scrubber.people:  # most data roots leave nothing out
            things = without(things, purged)
        if not things and job.ids and data.get("author") == PURGED:
            # A later request for its id then knows why it does not come.
            known = {name: data.get(name) for name in ("id", "link_id", "author")}
            things = [{"kind": kind, "data": known}]
        for thing in things:
            records.append(ExtractedRecord(end, _encode(thing), retrieved(thing["data"])))

    matches = search(chunk, take)
    return records, matches


def _encode(thing: dict[str, Any]) -> bytes:
    try:
        return msgspec.json.encode(thing)
    except UnicodeEncodeError:  # lone surrogates, which real titles hold
        return msgspec.json.encode(holdable(thing))


def _in_span(record: dict[str, Any], job: ImportJob) -> bool:
    """Whether a record is of the span. The filter judges records whose date can't be read."""
    try:
        at = float(record.get("created_utc"))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        at = -1.0
    return not 0 <= at < LATEST or job.since <= at < job.until


THINGS = 100  # records of an envelope


def import_file(job: ImportJob) -> DumpCursor:
    """Import one dump; its cursor. Memory is bounded by a chunk. Raises DiskFull."""
    root, file = Path(job.root), Path(job.file)
    name = job.note or note_name(file, job.since, job.until)
    cursor = load_cursor(root, name, job.file)
    base = rawlog.folder(root, "reddit", KIND)
    publish_segment(base, cursor)
    cursor.fresh = 0
    if cursor.done:
        return cursor
    progress = ReadProgress(cursor.lines, cursor.bad_lines, cursor.first_bad, sha256=job.sha256)
    segments = SegmentWriter(root, base, name, cursor)
    batch: list[ExtractedRecord] = []
    offset = cursor.offset
    with full_disk_is_resumable(root):
        for chunk, records, matches in _extracted(job, cursor, progress):
            for record in records:
                batch.append(record)
                if len(batch) == THINGS:
                    segments.write_envelope(batch, record.end)
                    batch = []
            offset = chunk.offset + chunk.end - chunk.begin
            progress.lines += matches.lines
            progress.count_damaged(matches.bad_lines, matches.first_bad)
            if segments.size >= job.segment_bytes:
                segments.write_envelope(batch, offset)
                batch = []
                segments.close(offset, progress)
        segments.write_envelope(batch, offset)
        cursor.truncated, cursor.problem = progress.truncated, progress.problem
        if not progress.stopped and not (job.limit and cursor.fresh >= job.limit):
            cursor.done, cursor.sha256 = True, progress.sha256
            cursor.size, cursor.samples = file.stat().st_size, samples_of(file)
        segments.close(offset, progress)
    return cursor


def _extracted(
    job: ImportJob, cursor: DumpCursor, progress: ReadProgress
) -> Iterator[tuple[Chunk, list[ExtractedRecord], ChunkMatches]]:
    """The chunks in their order with what `_extract` gives. With a limit nothing behind that many
    records counts as read.
    """
    home = Path(job.home or job.root)
    purged = frozenset(tombstones.keys(home, "reddit"))
    search = SubredditSearch(job.subreddit)
    if job.ids:
        index = IdIndex(Path(job.ids))
        search, purged = ById(index, job.subreddit), purged | index.purged
    scrubber = Scrubber(load_key(home), tombstones.people(home, "reddit"))
    left = job.limit

    def may_go_on() -> bool:
        return not job.lease or Path(job.lease).exists()

    for chunk in chunks(Path(job.file), progress, cursor.offset, may_go_on):
        records, matches = _extract(chunk, job, search, scrubber, purged)
        if left and len(records) >= left:
            size = records[left - 1].end - chunk.offset
            part = Chunk(chunk.offset, chunk.data[chunk.begin : chunk.begin + size], 0, size)
            yield part, *_extract(part, job, search, scrubber, purged)
            return
        left -= len(records) if left else 0
        yield chunk, records, matches


class SegmentWriter:
    """Writes the raw segments of one dump; each appears only when complete."""

    def __init__(self, root: Path, base: Path, name: str, cursor: DumpCursor) -> None:
        self.size = 0
        self._root, self._base, self._name, self._cursor = root, base, name, cursor
        self._base.mkdir(parents=True, exist_ok=True)
        self._compressor = rawlog.compressor()
        self._digest = hashlib.sha256()
        self._records = 0
        self._file: Any = None

    def write_envelope(self, records: list[ExtractedRecord], offset: int) -> None:
        """One envelope, shaped like a Listing. `offset` is behind its last line; it orders
        duplicates within a dump.
        """
        if not records:
            return
        if self._file is None:
            self._file = hidden(self._base, self._name).open("wb")
            self._digest = hashlib.sha256()
        times = [record.retrieved for record in records if record.retrieved is not None]
        at = f"{datetime.fromtimestamp(max(times), UTC):%Y-%m-%dT%H:%M:%SZ}" if times else None
        children = [msgspec.Raw(record.line) for record in records]
        answer = {"kind": "Listing", "data": {"children": children, "after": None}}
        request = Request(f"dump/{Path(self._cursor.file).name}", {"offset": offset})
        frame = self._compressor.compress(rawlog.encode(Envelope(at, request, 200, answer)))
        self._digest.update(frame)
        self._file.write(frame)
        self.size += len(frame)
        self._cursor.things += len(records)
        self._cursor.fresh += len(records)

    def close(self, offset: int, progress: ReadProgress) -> None:
        """Save the cursor, then let the segment appear."""
        cursor = self._cursor
        if self._file is not None:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._file, self.size = None, 0
            cursor.segments += 1
            # Named by content: segments of other machines, spans and rounds have other names.
            cursor.segment = f"{cursor.segments:06d}-{self._digest.hexdigest()[:16]}{SUFFIX}"
            os.rename(hidden(self._base, self._name), hidden(self._base, cursor.segment))
        cursor.offset, cursor.lines = offset, progress.lines
        cursor.bad_lines, cursor.first_bad = progress.bad_lines, progress.first_bad
        save_cursor(self._root, self._name, cursor)
        publish_segment(self._base, cursor)
