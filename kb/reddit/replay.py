"""The raw log taken into the frontier: of each answer is decoded what kb.reddit.reduce looks at."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, TypedDict

import msgspec

from kb.reddit import reduce
from kb.store import typed
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope


class _Thing(TypedDict, total=False):
    """A Listing, a post, a comment, a stub, or what holds them."""

    kind: Any
    data: _Data
    json: _More


class _Data(TypedDict, total=False):
    id: Any
    created_utc: Any
    parent_id: Any
    after: Any
    children: list[_Thing | str]
    replies: _Thing | str | None


class _More(TypedDict, total=False):
    data: _Things


class _Things(TypedDict, total=False):
    things: list[_Thing]


class _Answer(Envelope):
    response: _Thing | list[_Thing]


class _Asked(Envelope):
    response: msgspec.Raw


_TYPES: dict[str, type[Envelope]] = {
    "listings": _Answer,
    "comments": _Answer,
    "morechildren": _Answer,
    "info": _Asked,
}


@cache
def _decoder(kind: str) -> msgspec.json.Decoder[Any] | None:
    """None for kinds without effect on the frontier."""
    return msgspec.json.Decoder(_TYPES[kind]) if kind in _TYPES else None


def take_in(frontier: Frontier, kind: str, lines: Iterable[bytes]) -> None:
    """Take in lines of one raw kind. Raises DamagedData for a line that is no envelope."""
    decoder = _decoder(kind)
    for line in lines:
        if decoder is not None:
            reduce.reduce(frontier, kind, typed.decode(decoder, line))
