"""Recorded exchanges with Reddit (PRAW's own cassettes), as answers of a requests adapter."""

import json
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit

import requests
import urllib3
from requests.adapters import BaseAdapter

from kb.core.config.profile import load_profile
from kb.reddit.parse import answers as parse
from kb.store.rawlog.rawlog import Envelope, Request, encode


class Exchange(NamedTuple):
    """One recorded request and its answer."""

    method: str
    path: str
    query: dict[str, str]
    form: dict[str, str]
    status: int
    headers: dict[str, str]
    body: str


def read(path: Path) -> list[Exchange]:
    """The exchanges of a cassette, in order."""
    found = []
    for entry in json.loads(path.read_text(encoding="utf-8"))["interactions"]:
        request, response = entry["request"], entry["response"]
        address, form = urlsplit(request["uri"]), request["body"]
        form = form if isinstance(form, str) else (form or {}).get("string") or ""
        headers = {
            name: values[0]
            for name, values in response["headers"].items()
            if name.lower() != "content-length"
        }
        found.append(
            Exchange(
                request["method"],
                address.path,
                dict(parse_qsl(address.query)),
                dict(parse_qsl(form)),
                response["status"]["code"],
                headers,
                response["body"]["string"],
            )
        )
    return found


class Cassette(BaseAdapter):
    """Gives each recorded answer once, to the next request of its method and path."""

    def __init__(self, exchanges: list[Exchange]) -> None:
        super().__init__()
        self.left = list(exchanges)
        self.asked: list[requests.PreparedRequest] = []

    def send(self, request: requests.PreparedRequest, **options: Any) -> requests.Response:
        self.asked.append(request)
        path = unquote(urlsplit(request.url or "").path)
        exchange = next(
            (
                one
                for one in self.left
                if (one.method, one.path.rstrip("/")) == (request.method, path.rstrip("/"))
            ),
            None,
        )
        assert exchange is not None, f"{request.method} {request.url} is not on the cassette"
        self.left.remove(exchange)
        response = requests.Response()
        response.status_code, response.url, response.request = (
            exchange.status,
            request.url or "",
            request,
        )
        response.headers.update(exchange.headers)
        # A body that is not read yet, as from the network.
        body = BytesIO(exchange.body.encode())
        response.raw = urllib3.HTTPResponse(body, preload_content=False)
        return response

    def close(self) -> None:
        """Nothing is open."""


Row = dict[str, Any]
LINKS = load_profile("minecraft").section("reddit").links


def _kind(exchange: Exchange) -> str:
    for part, kind in (
        ("api/info", "info"),
        ("morechildren", "morechildren"),
        ("/comments/", "comments"),
    ):
        if part in exchange.path:
            return kind if not exchange.path.startswith("/r/") else "listings"
    return "listings"


def read_rows(kind: str, line: bytes) -> list[Row]:
    """The rows of an answer but for the marks of what was read."""
    rows = [row for part in parse.rows([line], kind, LINKS) for row in part.to_pylist()]
    return [row for row in rows if row["state"] not in parse.MARKS]


def rows_of(cassette: Path) -> list[Row]:
    """Rows of all answers of a cassette."""
    found: list[Row] = []
    for exchange in read(cassette):
        if exchange.status != 200 or "access_token" in exchange.path:
            continue
        kind, params = _kind(exchange), {**exchange.query, **exchange.form}
        if kind == "comments":
            params["article"] = exchange.path.split("/")[2]
        request, answer = Request(exchange.path, params), json.loads(exchange.body)
        found += read_rows(kind, encode(Envelope("2026-01-01T00:00:00Z", request, 200, answer)))
    return found
