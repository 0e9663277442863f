"""Chunks of a dump → the things in them, scrubbed and as JSON: what workers do for an import."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kb.reddit.dumps.chunks import Chunk, retrieved
from kb.reddit.dumps.id_search import ById, IdIndex
from kb.reddit.dumps.subreddit_search import SearchState, SubredditSearch
from kb.reddit.parse.anonymize import Scrubber, load_key
from kb.reddit.parse.remove_ids import without
from kb.schema.decode import holdable
from kb.store import tombstones


class RecordRules(msgspec.Struct, frozen=True):
    """Which records are wanted, and the root whose key and tombstones count; plain values.

    `ids` is a folder of kb.reddit.dumps.id_search: these records instead of the subreddit's, or,
    with a subreddit, these of it.
    """

    root: str
    subreddit: str
    since: float
    until: float
    tombstones: int  # when their file was changed, so that no process trusts an older one
    ids: str = ""


class Taken(NamedTuple):
    """A thing: the offset behind its line, its JSON, and when the archive read it (Unix time)."""

    end: int
    line: bytes
    read: int | None


class Looked(NamedTuple):
    """What a chunk holds: the offset behind it, its lines, damaged ones and where the first is."""

    offset: int
    lines: int
    bad_lines: int
    first_bad: int | None
    things: list[Taken]


def rules(root: Path, subreddit: str, since: float, until: float, ids: str = "") -> RecordRules:
    """The rules of an import as of now."""
    stamp = tombstones.version(root, "reddit")
    return RecordRules(str(root), subreddit, since, until, stamp, ids)


def search_of(rules: RecordRules, state: SearchState | None = None) -> SubredditSearch:
    """What finds the wanted records; `state` is what a search of the lines before has learned."""
    if rules.ids:
        return ById(_kept(rules.ids), rules.subreddit, state)
    return SubredditSearch(rules.subreddit, state)


def look(search: SubredditSearch, chunk: Chunk, rules: RecordRules) -> Looked:
    """The wanted things of a chunk, in their order."""
    scrubber, gone = _tools(rules.root, rules.tombstones, rules.ids)
    things: list[Taken] = []

    def take(end: int, record: dict[str, Any]) -> None:
        thing = _wanted(record, rules, gone)
        if thing is not None:
            data = scrubber.scrub(thing["data"])
            things.append(Taken(end, _encoded({**thing, "data": data}), retrieved(data)))

    found = search(chunk, take)
    offset = chunk.offset + chunk.end - chunk.begin
    return Looked(offset, found.lines, found.bad_lines, found.first_bad, things)


Block = tuple[tuple[int, bytes], ...]
"""Chunks of whole lines that follow each other: the offset of each, and its bytes."""


def look_at_block(
    block: Block, rules: RecordRules, state: SearchState
) -> tuple[list[Looked], SearchState]:
    """What each chunk of a block holds, and what the search knows behind it; runs in a worker.

    `state` is what it knew before, so that what is found follows from the file and from nothing
    that this worker had in hand.
    """
    search = search_of(rules, state)
    found = [look(search, Chunk(at, data, 0, len(data)), rules) for at, data in block]
    return found, search.state()


@cache
def _tools(root: str, stamp: int, ids: str) -> tuple[Scrubber, Collection[str]]:
    """Made once in each worker."""
    gone = tombstones.keys(Path(root), "reddit")
    return Scrubber(load_key(Path(root))), gone | _kept(ids).gone if ids else gone


@cache
def _kept(folder: str) -> IdIndex:
    """Read once in each worker."""
    return IdIndex(Path(folder))


def _encoded(thing: dict[str, Any]) -> bytes:
    try:
        return msgspec.json.encode(thing)
    except UnicodeEncodeError:  # lone surrogates, which real titles hold
        return msgspec.json.encode(holdable(thing))


def _wanted(
    record: dict[str, Any], rules: RecordRules, gone: Collection[str]
) -> dict[str, Any] | None:
    """The record as a thing, unless it is out of the span or purged. One whose date can't be read
    is left to the filter.
    """
    kind = "t3" if "title" in record else "t1"
    at = _made(record)
    if at is not None and not rules.since <= at < rules.until:
        return None
    left = without([{"kind": kind, "data": record}], gone)
    return left[0] if left else None


def _made(record: dict[str, Any]) -> float | None:
    """When a record was made, in seconds since 1970; None when it doesn't say so."""
    try:
        at = float(record.get("created_utc"))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return None
    return at if 0 <= at < 253402300800 else None
