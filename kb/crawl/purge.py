"""Purge of raw answers: what a source's schemas say of keys is enough to take them out.

begin      the list of what goes is written down, and their tombstones
asides     damaged bytes that may hold one of them
answers    each raw segment again without them, as `x-keys` of its kind says
frontier   their items
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import msgspec

from kb.core.context import Run
from kb.crawl.session import Session, open_session
from kb.crawl.source import Source
from kb.schema import keys as schema
from kb.store import mending, purge
from kb.store.purge import Strip
from kb.store.rawlog import Envelope, Request


class Keys(dict[str, str]):
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


def purge_raw(
    run: Run,
    source: Source,
    collect: Callable[[Session], Keys],
    *,
    kinds: Sequence[str] = (),
    exact: Sequence[str] = (),
    remove: Callable[[Session, Keys], None] | None = None,
) -> Keys:
    """Take keys out of a source's raw answers and frontier; the keys, for all that is made of them.

    `collect` says what is to go; nothing is sent. Items of the frontier's `kinds` go by their key.
    `exact` are raw kinds with one answer a key, whose damaged bytes may stay. `remove` rewrites the
    raw answers where more than the keys' answers goes with them. Raises WriterLocked, DiskFull.
    """
    with open_session(run, source, asks=False, every=True) as session:
        # Opening it has set damage aside and taken in what was not read yet.
        session.recorder.close()
        collected = collect(session)
        keys = Keys(purge.begin(run.root, source.name, collected), collected.said)
        if not keys:
            return keys
        frontier = session.frontier
        mending.drop_asides(run.root, source.name, frontier, keys, exact)
        if remove is not None:
            remove(session, keys)
        else:
            strip = strip_of(source.name)
            purge.rewrite_raw(run.root, source.name, keys.keys(), strip, frontier, sought=keys)
        for kind in kinds:
            frontier.remove(kind, keys)
        return keys
