"""A site of questions and answers on loopback: pages, batches, a key, a quota a day."""

import json
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

KEY = "the-key-of-the-site"
PAGE, MOST = 4, 20  # entries of a page, keys of a request


class Site:
    """Questions 101, 102 … with two answers each, 1011 and 1012; `scores` are -2, -1, 0, 1 ….

    `asked` counts requests by path; `fault` may answer with a status instead.
    """

    def __init__(self, questions: int) -> None:
        self.ids = list(range(101, 101 + questions))
        self.deleted: set[int] = set()
        self.asked: Counter[str] = Counter()
        self.fault: Callable[[str], int | None] = lambda path: None
        self.title: Callable[[int], str] = lambda key: f"How is thing {key} made?"
        self.body: Callable[[int], str] = lambda key: f"I have no idea how to make thing {key}."
        self.root = ""

    def answer(self, address: str) -> tuple[int, Any]:
        """Status and body."""
        url = urlsplit(address)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        self.asked[url.path] += 1
        if (planted := self.fault(url.path)) is not None:
            return planted, {"error": "planted"}
        if query.get("key") != KEY:
            return 403, {"error": "a wrong key"}
        parts = url.path.strip("/").split("/")
        there = [one for one in self.ids if one not in self.deleted]
        if parts[1:]:
            wanted = list(map(int, parts[1].split(";")))
            if len(wanted) > MOST:
                return 400, {"error": "too many ids"}
            there = [one for one in there if one in wanted]
        entries = [self._question(one) for one in there]
        if parts[2:] == ["answers"]:
            entries = [entry for one in there for entry in self._answers(one)]
        elif parts[1:]:
            return 200, {"items": entries, "has_more": False}
        first = (int(query.get("page", "1")) - 1) * PAGE
        more = first + PAGE < len(entries)
        return 200, {"items": entries[first : first + PAGE], "has_more": more}

    def _question(self, key: int) -> dict[str, Any]:
        numbers = {"question_id": key, "score": key - 103, "creation_date": 1_700_000_000 + key}
        return {**numbers, "title": self.title(key), "body": self.body(key)}

    def _answers(self, key: int) -> list[dict[str, Any]]:
        return [
            {"answer_id": key * 10 + n, "question_id": key, "score": 3 - 4 * n, "body": body}
            for n, body in enumerate((f"Thing {key} needs a furnace.", "Nobody knows."))
        ]


class TextSite(Site):
    """The same with ids that are any text; its list of all questions goes on by a cursor."""

    def __init__(self, ids: list[str]) -> None:
        super().__init__(0)
        self.ids: list[Any] = ids

    def answer(self, address: str) -> tuple[int, Any]:
        """Status and body."""
        url = urlsplit(address)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        self.asked[url.path] += 1
        if query.get("key") != KEY:
            return 403, {"error": "a wrong key"}
        parts = url.path.strip("/").split("/")
        if not parts[1:]:
            cursors = [None, *(f"after {key}" for key in self.ids[PAGE - 1 :: PAGE])]
            if query.get("cursor") not in cursors:
                return 400, {"error": "no such cursor"}
            first = cursors.index(query.get("cursor")) * PAGE
            entries = [self._question(key) for key in self.ids[first : first + PAGE]]
            following = [*cursors, ""][cursors.index(query.get("cursor")) + 1]
            return 200, {"items": entries, "next": following}
        wanted = [unquote(part) for part in parts[1].split(";")]
        there = [key for key in self.ids if key in wanted and key not in self.deleted]
        make = self._answers if parts[2:] == ["answers"] else lambda key: [self._question(key)]
        return 200, {"items": [entry for key in there for entry in make(key)], "next": ""}

    def _question(self, key: Any) -> dict[str, Any]:
        texts = {"title": f"How is {key} made?", "body": f"I have no idea how to make {key}."}
        return {"question_id": key, "score": 1, "creation_date": 1_700_000_000, **texts}

    def _answers(self, key: Any) -> list[dict[str, Any]]:
        body = f"{key} needs a furnace."
        return [{"answer_id": f"{key}, first", "question_id": key, "score": 1, "body": body}]


@contextmanager
def serving(site: Site) -> Iterator[Site]:
    """The site on loopback until the block ends."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status, body = site.answer(self.path)
            data = json.dumps(body).encode()
            self.send_response(status)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *values: object) -> None:
            """Nothing to tell."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    site.root = f"http://127.0.0.1:{server.server_port}"
    try:
        yield site
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
