"""The notes of a small feed.

GET /notes?page=N    {"notes": [{"id": "n1"}, …], "next": 2 or null}
GET /notes/<id>      {"id": "n1", "text": "…", "likes": 3}; 404 for a note that was taken back
"""

from collections.abc import Iterator
from typing import Any

from kb.core.context import Run
from kb.core.errors import Blocked, ItemFinal, Retryable
from kb.crawl.connector import Answer, Connector, Phase
from kb.net.session import HttpSession, send
from kb.store.rawlog.rawlog import Envelope
from kb.store.state.frontier import Frontier, Item

PAGES = Phase(kind="pages", unit="pages", feeds=("notes",))
NOTES = Phase(kind="notes", unit="notes", limited=True)


class FeedConnector(Connector):
    """The feed at one address."""

    name = "feed"
    phases = (NOTES, PAGES)

    def __init__(self, run: Run, url: str = "") -> None:
        self._url = url or run.profile.section("feed").url
        self._session = HttpSession(run.settings)

    def identity(self) -> dict[str, str]:
        """The feed's address."""
        return {"feed": self._url}

    def discover(self, frontier: Frontier) -> None:
        """The first page."""
        frontier.add_keys("pages", ["1"])

    def fetch(self, phase: Phase, items: list[Item]) -> Iterator[Answer]:
        """One page, or one note."""
        (item,) = items
        path, name = ("/notes", "page") if phase is PAGES else (f"/notes/{item.key}", "id")
        asked = {name: item.key}
        answer = self._ask(path, asked if phase is PAGES else {})
        yield Answer(phase.kind, path, asked, answer)

    def reduce(self, frontier: Frontier, kind: str, envelope: Envelope) -> None:
        """A page adds its notes and the next page."""
        if kind == "notes":
            frontier.add_keys("notes", [envelope.request.params["id"]])
            frontier.done("notes", envelope.request.params["id"])
            return
        page, following = envelope.request.params["page"], envelope.response["next"]
        frontier.add_keys("notes", [note["id"] for note in envelope.response["notes"]])
        frontier.add_keys("pages", [page, *([str(following)] if following else [])])
        frontier.done("pages", page)

    def _ask(self, path: str, params: dict[str, str]) -> Any:
        response = send(self._session, "GET", self._url + path, params=params)
        if response.status_code == 404:
            raise ItemFinal("taken_back")
        if response.status_code == 403:
            raise Blocked("the feed rejects requests", hint="come back later", after=60.0)
        try:
            return response.json()
        except ValueError:
            raise Retryable("an answer that is not JSON") from None

    def close(self) -> None:
        """Close the connections."""
        self._session.close()
