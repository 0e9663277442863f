"""A fourth source, as a contributor would write it: the notes of a small feed.

GET /notes?page=N    {"ids": ["a", "b"], "next": 2 or null}
GET /notes/<id>      {"id": "a", "text": "…"}; 404 for a note that was taken back
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import requests

from kb.core.errors import Blocked, ItemFinal, Retryable
from kb.crawl.source import Answer, Phase, Plain
from kb.net.session import HttpSession, send
from kb.store.frontier import Frontier, Item
from kb.store.rawlog import Envelope

PAGES = Phase(kind="pages", unit="pages", feeds=("notes",))
NOTES = Phase(kind="notes", unit="notes", limited=True)


class Page(msgspec.Struct):
    """What the frontier knows of a page."""

    number: int


PAYLOADS: Mapping[str, type[msgspec.Struct]] = {"pages": Page}


class Feed(Plain):
    """The feed at one address."""

    name = "feed"
    phases = (NOTES, PAGES)
    payloads = PAYLOADS

    def __init__(self, settings: Any, root: str) -> None:
        self._root, self._session = root, HttpSession(settings)

    def identity(self) -> dict[str, str]:
        """The feed's address."""
        return {"feed": self._root}

    def discover(self, frontier: Frontier) -> None:
        """The first page."""
        frontier.add("pages", [("1", {"number": 1})])

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """One page, or one note."""
        (item,) = items
        if phase is PAGES:
            params = {"page": item.payload.number}
            yield Answer("pages", "notes", params, self._ask("/notes", params))
        else:
            note = self._ask(f"/notes/{item.key}", {})
            yield Answer("notes", "note", {"id": item.key}, note)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """A page adds its notes and the next page."""
        if kind == "notes":
            key = envelope.request.params["id"]
            frontier.add("notes", [key])
            frontier.done("notes", key)
            return
        number, following = envelope.request.params["page"], envelope.response["next"]
        frontier.add("notes", envelope.response["ids"])
        frontier.add("pages", [(str(number), {"number": number})])
        if following is not None:
            frontier.add("pages", [(str(following), {"number": following})])
        frontier.done("pages", str(number))

    def _ask(self, path: str, params: dict[str, int]) -> Any:
        response = send(self._session, "GET", self._root + path, params=params)
        return _judged(response)

    def close(self) -> None:
        """Close the connections."""
        self._session.close()


def _judged(response: requests.Response) -> Any:
    """The answer, or what follows from an answer that is none."""
    if response.status_code == 404:
        raise ItemFinal("taken_back")
    if response.status_code == 403:
        raise Blocked("the feed rejects requests", hint="come back later", after=60.0)
    try:
        return response.json()
    except ValueError:
        raise Retryable("an answer that is no JSON") from None
