"""The feed's service on loopback, with faults that a test plants."""

import json
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Service:
    """`asked` counts requests by path; `fault` answers instead: (status, headers), or None."""

    def __init__(self, notes: int, page: int) -> None:
        self.page = page
        self.ids = [f"n{number:03d}" for number in range(notes)]
        self.asked: Counter[str] = Counter()
        self.fault: Callable[[str], tuple[int, dict[str, str]] | None] = lambda path: None
        self.root = ""

    def answer(self, path: str) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of one request."""
        self.asked[path] += 1
        planted = self.fault(path)
        if planted is not None:
            status, headers = planted
            return status, headers, headers.get("X-Body", "{}").encode()
        if path.startswith("/notes?page="):
            number = int(path.rpartition("=")[2])
            ids = self.ids[(number - 1) * self.page : number * self.page]
            following = number + 1 if number * self.page < len(self.ids) else None
            return (
                200,
                {},
                json.dumps({"notes": [{"id": one} for one in ids], "next": following}).encode(),
            )
        key = path.rpartition("/")[2]
        body = {
            "id": key,
            "text": f"the text of {key}",
            "likes": int(key[1:] or 0) if key[1:].isdigit() else 0,
        }
        return (200, {}, json.dumps(body).encode()) if key in self.ids else (404, {}, b"{}")


@contextmanager
def serving(notes: int, page: int = 3) -> Iterator[Service]:
    """The service with so many notes, so many a page, until the block ends."""
    service = Service(notes, page)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status, headers, body = service.answer(self.path)
            self.send_response(status)
            for name, value in {**headers, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *values: object) -> None:
            """Nothing to tell."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    service.root = f"http://127.0.0.1:{server.server_port}"
    try:
        yield service
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
