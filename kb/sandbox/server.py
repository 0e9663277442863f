"""Serves the sandbox on loopback: one threading server per service, each on a port of its own.

with Sandbox(World()) as sandbox:
    os.environ |= sandbox.settings()
    sandbox.servers["youtube"].stop()      # connections are refused
    sandbox.servers["youtube"].start()     # … and accepted again, on the same port
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Self

from werkzeug.serving import WSGIRequestHandler, make_server

from kb.sandbox import toxicity
from kb.sandbox.reddit import service as reddit
from kb.sandbox.wiki import service as wiki
from kb.sandbox.world import World
from kb.sandbox.youtube import service as youtube

SERVICES: dict[str, Any] = {
    "youtube": youtube,
    "wiki": wiki,
    "reddit": reddit,
}
HOST = "127.0.0.1"
Wsgi = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]


class _RequestHandler(WSGIRequestHandler):
    """Logs no requests to stderr."""

    def handle(self) -> None:
        with contextlib.suppress(OSError):  # of connections that the client or a test broke
            super().handle()

    def log(self, type: str, message: str, *args: Any) -> None:
        if type == "error" and "Error on request" in message:
            super().log(type, message, *args)


class Server:
    """One WSGI application on a loopback port, with a thread for each request."""

    def __init__(self, application: Wsgi) -> None:
        self.application = application
        self.port = 0
        self._server: Any = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """The root, without a trailing slash."""
        return f"http://{HOST}:{self.port}"

    def start(self) -> Server:
        """Listen, on the same port as before if there was one. Raises OSError."""
        self._server = make_server(
            HOST, self.port, self.application, threaded=True, request_handler=_RequestHandler
        )
        self._server.daemon_threads = True
        self._server.block_on_close = False  # a held request must not keep the server from ending
        self.port = self._server.server_port
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        )
        self._thread.start()
        return self

    def stop(self) -> None:
        """Stop listening: new connections are refused."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None
        if self._thread is not None:
            self._thread.join()
            self._thread = None


class Sandbox:
    """The services over one world; `requests` counts what they were asked."""

    known: ClassVar[dict[str, Any]] = SERVICES  # tests add services of their own

    def __init__(self, world: World | None = None, services: Sequence[str] = tuple(SERVICES)):
        self.world = world or World()
        self.requests = 0
        self.applications: dict[str, Any] = {
            name: self.known[name].app(self.world) for name in services
        }
        self.servers = {name: Server(self.mounted(name)) for name in services}

    def mounted(self, name: str) -> Wsgi:
        """The service as its server calls it."""

        def serve(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
            self.requests += 1
            answer: Iterable[bytes] = self.applications[name](environ, start_response)
            return answer

        return serve

    def settings(self, *, model: bool = False) -> dict[str, str]:
        """The settings that point at the services; with `model` also at the tiny toxicity model,
        which is made on first use.

        Raises MissingExtra for `model` without the extra that it needs.
        """
        values = {"KB_CONTACT": "sandbox@lorecrawl.invalid"}
        for name, server in self.servers.items():
            values |= self.known[name].settings(server.url)
        return values | (toxicity.settings() if model else {})

    def start(self) -> Self:
        """Listen."""
        for server in self.servers.values():
            server.start()
        return self

    def stop(self) -> None:
        """Stop listening."""
        for server in self.servers.values():
            server.stop()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *error: object) -> None:
        self.stop()
