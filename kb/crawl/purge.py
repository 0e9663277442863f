"""Purge of raw answers: what a source's schemas say of keys is enough to take them out.

search     every byte of the raw answers is read; where one may stand, and what is damaged
begin      the list of what goes is written down, and their tombstones
asides     damaged bytes that may hold one of them
answers    raw segments that hold one again without them, as `x-keys` of their kind says
frontier   their items
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeVar

import msgspec

from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.crawl.session import CrawlSession, open_session
from kb.crawl.source import Source
from kb.schema import keys as schema
from kb.store import mending, purge, rawlog
from kb.store.purge import Strip
from kb.store.purge_search import Found, Holds, everything, finder, search, standing
from kb.store.rawlog import Envelope, Request

T = TypeVar("T")


class PurgeKeys(dict[str, str]):
    """What a purge removes, key → reason; `said`: what its summary says besides."""

    said: dict[str, int]

    def __init__(self, reasons: dict[str, str], said: dict[str, int] | None = None) -> None:
        super().__init__(reasons)
        self.said = said or {}


def strip_of(source: str, others: Mapping[str, Collection[str]] | None = None) -> Strip:
    """How keys leave a source's answers, as the schemas of its raw kinds say.

    `others` are the other names of what goes, as `of` of the schemas calls them.
    """
    others = others or {}

    def without(kind: str, envelope: Envelope, keys: Collection[str]) -> Envelope | None:
        request, response = envelope.request, envelope.response
        gone = {**others, "": keys}
        left = schema.without(f"{source}/{kind}", request.params, response, gone)
        if left is None:
            return None
        if left[0] is request.params and left[1] is response:
            return envelope
        return msgspec.structs.replace(
            envelope, request=Request(request.endpoint, left[0]), response=left[1]
        )

    return without


def collected(session: CrawlSession, collect: Callable[[], PurgeKeys]) -> PurgeKeys:
    """What is to go, together with what an unfinished purge left.

    Nothing but damage is written: what can't be read is set aside, to be told later.
    """
    return _mended(session, lambda: _all(session, collect))


def searched(
    session: CrawlSession,
    collect: Callable[[], PurgeKeys],
    holding: Callable[[Collection[str]], Holds] | None = None,
) -> tuple[PurgeKeys, Found]:
    """The same, and which answers may hold it; `holding` makes of keys what tells that, instead of
    the schemas.
    """
    run, name = session.run, session.source.name

    def read() -> tuple[PurgeKeys, Found]:
        keys = _all(session, collect)
        if holding is not None:
            return keys, search(run.root, name, holding(keys), run.workers)
        named = {kind: schema.fields(f"{name}/{kind}") for kind in rawlog.kinds(run.root, name)}
        own = {kind: standing(keys, fields) for kind, fields in named.items() if fields}
        return keys, search(run.root, name, finder(keys), run.workers, own)

    return _mended(session, read)


def _all(session: CrawlSession, collect: Callable[[], PurgeKeys]) -> PurgeKeys:
    keys = collect()
    keys.update({**purge.left_over(session.run.root, session.source.name), **keys})
    return keys


def _mended(session: CrawlSession, read: Callable[[], T]) -> T:
    """What `read` reads of the raw answers, damaged ones set aside."""
    try:
        return read()
    except DamagedData as error:
        if getattr(error, "path", None) is None:
            raise
        session.recorder.look_into_all()
        return read()


def purge_raw(
    run: Run,
    source: Source,
    collect: Callable[[CrawlSession], PurgeKeys],
    *,
    kinds: Sequence[str] = (),
    exact: Sequence[str] = (),
    remove: Callable[[CrawlSession, PurgeKeys, Found], None] | None = None,
) -> PurgeKeys:
    """Take keys out of a source's raw answers and frontier; the keys, for all that is made of them.

    `collect` says what is to go; nothing is sent. Items of the frontier's `kinds` go by their key.
    `exact` are raw kinds with one answer a key, whose damaged bytes may stay. `remove` rewrites the
    raw answers where more than the keys' answers goes with them; any may hold such. Raises
    WriterLocked, DiskFull, Interrupted.
    """
    with open_session(run, source, asks=False, tells=False) as session:
        # Opening it has taken in what was not read yet.
        session.recorder.close()
        holding = None if remove is None else everything
        keys, found = searched(session, lambda: collect(session), holding)
        purge.begin(run.root, source.name, keys)
        if not keys:
            return keys
        frontier = session.frontier
        mending.drop_asides(run.root, source.name, frontier, keys, exact)
        if remove is not None:
            remove(session, keys, found)
        else:
            strip = strip_of(source.name)
            purge.rewrite_raw(
                run.root, source.name, keys.keys(), strip, frontier, found, run.workers
            )
        for kind in kinds:
            frontier.remove(kind, keys)
        return keys
