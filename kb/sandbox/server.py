"""The sandbox's services on loopback: one threading server a service, each on a port of its own.

with Sandbox(World()) as sandbox:
    os.environ |= sandbox.settings()
    sandbox.faults.add("/youtube/v3/search", status=503)
    sandbox.gone("youtube")      # nobody listens any more
    sandbox.back("youtube")      # … and again, on the same port
"""

from __future__ import annotations

import contextlib
import importlib
import threading
from collections.abc import Sequence
from typing import Any, Self

from werkzeug.serving import WSGIRequestHandler, make_server

from kb.sandbox import toxicity
from kb.sandbox.faults import Faults, Wsgi
from kb.sandbox.world import World

SERVICES = ("youtube", "wiki", "reddit", "zenodo")
HOST = "127.0.0.1"


class Server:
    """One WSGI application on a loopback port, served by a thread a request."""

    def __init__(self, application: Wsgi) -> None:
        self.application = application
        self.port = 0
        self._server: Any = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """The root, without a slash at its end."""
        return f"http://{HOST}:{self.port}"

    def start(self) -> Server:
        """Listen, on the same port as before if there was one. Raises OSError."""

        class Quiet(WSGIRequestHandler):
            """Requests are in the ledger, not on stderr."""

            def handle(self) -> None:
                """Connections that the fault plan broke have no more to say."""
                with contextlib.suppress(OSError):
                    super().handle()

            def log(self, type: str, message: str, *args: Any) -> None:
                if type == "error" and "Error on request" in message:
                    super().log(type, message, *args)

        self._server = make_server(
            HOST, self.port, self.application, threaded=True, request_handler=Quiet
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
    """The services over one world, with one fault plan and one ledger."""

    def __init__(
        self,
        world: World | None = None,
        services: Sequence[str] = SERVICES,
    ) -> None:
        self.world = world or World()
        self.faults = Faults()
        self.servers: dict[str, Server] = {}
        self._modules: dict[str, Any] = {}
        for name in services:
            self._modules[name] = importlib.import_module(f"kb.sandbox.{name}.service")
            self.servers[name] = Server(self._modules[name].app(self.world, self.faults))

    @property
    def ledger(self) -> Any:
        """Every request so far (kb.sandbox.ledger.Ledger)."""
        return self.faults.ledger

    def settings(self, *, model: bool = False) -> dict[str, str]:
        """The settings that point at the services; `model`: the tiny toxicity model's too, made
        when there is none.

        Raises MissingExtra for `model` without the extra that it needs.
        """
        values = {"KB_CONTACT": "sandbox@lorecrawl.invalid"}
        for name, server in self.servers.items():
            values |= self._modules[name].settings(server.url)
        if model:
            values |= toxicity.settings()
        return values

    def start(self) -> Self:
        """Listen."""
        for server in self.servers.values():
            server.start()
        return self

    def stop(self) -> None:
        """Release what is held and stop listening."""
        self.faults.clear()
        for server in self.servers.values():
            server.stop()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *error: object) -> None:
        self.stop()
