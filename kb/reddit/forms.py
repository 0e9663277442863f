"""The usual form of Reddit's answers, around any type of thing: what kb.reddit.plain and
kb.reddit.heads decode. Whatever has another form is read field by field by kb.reddit.parse.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Generic, Literal, TypeVar

import msgspec
from msgspec import UNSET, UnsetType

from kb.reddit import tree
from kb.reddit.dumps import LATEST, retrieved

Thing = TypeVar("Thing")


class Children(msgspec.Struct, Generic[Thing], gc=False):
    """What a listing holds."""

    children: list[Thing]


class ListingForm(msgspec.Struct, Generic[Thing], gc=False):
    """A page of things; the replies to a comment are one too."""

    kind: Literal["Listing"]
    data: Children[Thing]


class Things(msgspec.Struct, Generic[Thing], gc=False):
    """What an answer about stubs holds."""

    things: list[Thing]


class ThingData(msgspec.Struct, Generic[Thing], gc=False):
    """Around it."""

    data: Things[Thing]


class More(msgspec.Struct, Generic[Thing], gc=False):
    """An answer about stubs. What has a kind is a thing, and no such answer."""

    json: ThingData[Thing]
    kind: UnsetType = UNSET


class TypedRequest(msgspec.Struct, gc=False):
    """What was asked."""

    endpoint: str
    params: dict[str, Any]


class TypedEnvelope(msgspec.Struct, Generic[Thing], gc=False):
    """A line of the raw log with an answer of status 200; `response` by the raw kind."""

    fetched_at: str | None
    request: TypedRequest
    status: Literal[200]
    response: Thing


@cache
def decoder(kind: str, thing: Any) -> msgspec.json.Decoder[Any]:
    """Reads lines of a raw kind whose things are of the type `thing`."""
    answers: dict[str, Any] = {
        "comments": list[ListingForm[thing]] | ListingForm[thing],
        "morechildren": More[thing],
    }
    return msgspec.json.Decoder(TypedEnvelope[answers.get(kind, ListingForm[thing])])  # type: ignore[misc]


def things_of(envelope: TypedEnvelope[Any]) -> list[Any] | None:
    """The things of an answer, parents before replies; None where only a part of them counts,
    row by row: what is outside of the span that was asked for.
    """
    if {"since", "until"} & envelope.request.params.keys():
        return None
    response = envelope.response
    if isinstance(response, More):
        stack = response.json.data.things[::-1]
    else:
        listings = response if isinstance(response, list) else [response]
        stack = [one for listing in listings for one in listing.data.children][::-1]
    things = []
    while stack:
        thing = stack.pop()
        things.append(thing)
        if thing.kind == tree.COMMENT and type(thing.data.replies) is ListingForm:
            stack += thing.data.replies.data.children[::-1]
    return things


def read_at(record: Any) -> int | None:
    """When the archive read a record; a dump's envelope holds records of different times."""
    utc, on = record.retrieved_utc, record.retrieved_on
    if utc is UNSET and type(on) is int and 0 < on < LATEST:
        return on
    return retrieved({"retrieved_utc": utc, "retrieved_on": on})
