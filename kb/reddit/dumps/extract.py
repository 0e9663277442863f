"""Chunks of a dump → the wanted records, anonymized and as JSON. Runs in an import's workers."""

from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kb.reddit.dumps.chunks import Chunk
from kb.reddit.dumps.id_search import ById, IdIndex
from kb.reddit.dumps.subreddit_search import SubredditSearch
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.reddit.parse.people import PURGED
from kb.reddit.parse.removal import LATEST, retrieved
from kb.reddit.parse.remove_ids import without
from kb.schema.decode import holdable
from kb.store.state import tombstones


class RecordRules(msgspec.Struct, frozen=True):
    """Which records are wanted, and the root whose key and tombstones count; plain values.

    `ids` is a folder of kb.reddit.dumps.id_search: these records instead of the subreddit's, or,
    with a subreddit, these of it. `tombstones` is when their file was modified, so that no process
    uses an older one.
    """

    root: str
    subreddit: str
    since: float
    until: float
    tombstones: int
    ids: str = ""


class ExtractedRecord(NamedTuple):
    """A post or comment: the offset behind its line, its JSON, and when the archive read it last
    (Unix time).
    """

    end: int
    line: bytes
    retrieved: int | None


class ExtractedChunk(NamedTuple):
    """What a chunk holds: the offset behind it, its lines, damaged ones and where the first is."""

    offset: int
    lines: int
    bad_lines: int
    first_bad: int | None
    records: list[ExtractedRecord]


def extract(chunks: list[Chunk], rules: RecordRules, limit: int = 0) -> list[ExtractedChunk]:
    """The wanted records of consecutive chunks. Runs in a worker.

    With a `limit` nothing behind that many records counts as read.
    """
    search = _search(rules.subreddit, rules.ids)
    extracted = []
    for chunk in chunks:
        one = _extract_chunk(search, chunk, rules)
        if limit and len(one.records) >= limit:
            size = one.records[limit - 1].end - chunk.offset
            part = Chunk(chunk.offset, chunk.data[chunk.begin : chunk.begin + size], 0, size)
            extracted.append(_extract_chunk(search, part, rules))
            break
        limit -= len(one.records) if limit else 0
        extracted.append(one)
    return extracted


def _search(subreddit: str, ids: str) -> SubredditSearch:
    return ById(_id_index(ids), subreddit) if ids else SubredditSearch(subreddit)


def _extract_chunk(search: SubredditSearch, chunk: Chunk, rules: RecordRules) -> ExtractedChunk:
    scrubber, purged = _tools(rules.root, rules.tombstones, rules.ids)
    records: list[ExtractedRecord] = []

    def take(end: int, record: dict[str, Any]) -> None:
        if not _in_span(record, rules):
            return
        kind = "t3" if "title" in record else "t1"
        data = scrubber.scrub(record)
        things = [{"kind": kind, "data": data}]
        if purged or scrubber.people:  # most data roots leave nothing out
            things = without(things, purged)
        if not things and rules.ids and data.get("author") == PURGED:
            # Whoever asks for it by its id is told why it does not come.
            known = {name: data.get(name) for name in ("id", "link_id", "author")}
            things = [{"kind": kind, "data": known}]
        for thing in things:
            records.append(ExtractedRecord(end, _encode(thing), retrieved(thing["data"])))

    matches = search(chunk, take)
    offset = chunk.offset + chunk.end - chunk.begin
    return ExtractedChunk(offset, matches.lines, matches.bad_lines, matches.first_bad, records)


@cache
def _tools(root: str, stamp: int, ids: str) -> tuple[Scrubber, Collection[str]]:
    """The anonymizer and the purged names; made once in each worker."""
    purged = tombstones.keys(Path(root), "reddit")
    scrubber = Scrubber(load_key(Path(root)), tombstones.people(Path(root), "reddit"))
    return scrubber, purged | _id_index(ids).purged if ids else purged


@cache
def _id_index(folder: str) -> IdIndex:
    """Read once in each worker."""
    return IdIndex(Path(folder))


def _encode(thing: dict[str, Any]) -> bytes:
    try:
        return msgspec.json.encode(thing)
    except UnicodeEncodeError:  # lone surrogates, which real titles hold
        return msgspec.json.encode(holdable(thing))


def _in_span(record: dict[str, Any], rules: RecordRules) -> bool:
    """Whether a record is of the span. The filter judges records whose date can't be read."""
    try:
        at = float(record.get("created_utc"))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        at = -1.0
    return not 0 <= at < LATEST or rules.since <= at < rules.until
