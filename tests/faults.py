"""The sandbox with planned faults, and the ledger of the requests that its services received.

Beside the sandbox's three sources it can serve what a release is published to, if a test names it:
"zenodo" and "hub".

with Sandbox(World()) as sandbox:
    sandbox.faults.add("/youtube/v3/videos", status=503, times=2)  # the next two
    sandbox.faults.add("/youtube/v3/videos", after=3, reset=True)  # the fourth: connection reset
    fault = sandbox.faults.add("/watch", hold=True); fault.arrived.wait(); fault.release()
"""

import json
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl, urlencode

from kb.core import clock
from kb.sandbox import server
from kb.sandbox.server import Wsgi
from tests.services import zenodo
from tests.services.hub import service as hub

_SECRET = {"key", "access_token", "client_secret", "password", "refresh_token", "code"}


@dataclass
class LoggedRequest:
    """One request. `query` has no credentials; `about` is the item that the service says it was
    for (a video id …).
    """

    number: int
    time: float
    service: str
    method: str
    path: str
    query: str
    agent: str
    status: int | None = None  # None: no answer was sent (reset, still held)
    units: int = 0
    bucket: str = ""
    about: str = ""
    args: dict[str, str] = field(default_factory=dict)


class Ledger:
    """Every request in the order of arrival; thread-safe."""

    def __init__(self) -> None:
        self._requests: list[LoggedRequest] = []
        self._lock = threading.Lock()

    def open(self, service: str, environ: dict[str, Any]) -> LoggedRequest:
        """Record a request that has just arrived."""
        query = parse_qsl(environ.get("QUERY_STRING", ""), keep_blank_values=True)
        args = [pair for pair in query if pair[0] not in _SECRET]
        with self._lock:
            request = LoggedRequest(
                number=len(self._requests),
                time=clock.monotonic(),
                service=service,
                method=environ["REQUEST_METHOD"],
                path=environ.get("PATH_INFO", ""),
                query=urlencode(args),
                agent=environ.get("HTTP_USER_AGENT", ""),
                args=dict(args),
            )
            self._requests.append(request)
        return request

    def requests(self, path: str = "", *, service: str = "", since: int = 0) -> list[LoggedRequest]:
        """Requests whose path matches the regular expression `path`, from number `since` on."""
        with self._lock:
            recorded = self._requests[since:]
        return [
            request
            for request in recorded
            if re.search(path, request.path) and service in ("", request.service)
        ]

    def units(self, bucket: str = "general", *, since: int = 0) -> int:
        """Quota units that the requests cost."""
        return sum(one.units for one in self.requests(since=since) if one.bucket == bucket)

    def __len__(self) -> int:
        return len(self._requests)


@dataclass
class Fault:
    """One fault; `Faults.add` documents the fields. `hits` counts how often it struck."""

    path: str
    service: str = ""
    method: str = ""
    after: int = 0
    times: int | None = 1
    status: int | None = None
    body: bytes | str | dict[str, Any] | Callable[[dict[str, Any]], bytes] = b""
    headers: dict[str, str] = field(default_factory=dict)
    reset: bool = False
    cut: float | None = None
    honest: bool = False
    hold: bool = False
    then: Callable[[LoggedRequest], None] | None = None
    when: Callable[[dict[str, Any]], bool] | None = None
    hits: int = 0
    matches: int = 0
    arrived: threading.Event = field(default_factory=threading.Event)
    released: threading.Event = field(default_factory=threading.Event)

    def release(self) -> None:
        """Let held requests go on."""
        self.released.set()

    def strikes(self, environ: dict[str, Any], service: str) -> bool:
        """Whether this request is one of those meant. Called under the plan's lock."""
        target = f"{environ.get('PATH_INFO', '')}?{environ.get('QUERY_STRING', '')}"
        if self.service not in ("", service) or self.method not in ("", environ["REQUEST_METHOD"]):
            return False
        if not re.search(self.path, target) or (self.when and not self.when(environ)):
            return False
        self.matches += 1
        if self.matches <= self.after or (self.times is not None and self.hits >= self.times):
            return False
        self.hits += 1
        return True


class Faults:
    """The plan and the ledger of one sandbox; thread-safe."""

    def __init__(self) -> None:
        self.ledger = Ledger()
        self._plan: list[Fault] = []
        self._lock = threading.Lock()

    def add(self, path: str = "", **fields: Any) -> Fault:
        """Plan a fault for requests whose `path?query` matches the regular expression `path`.

        Which requests: `service`, `method`, `when(environ)`; the first `after` matches are skipped,
        then `times` are struck (None: all of them). What happens: `status`, `headers`, `body`
        (bytes, text, a dict sent as JSON, or a function of environ) instead of the service; `reset`
        the connection; `cut` the service's body to this fraction (`honest`: with a Content-Length
        that fits the cut body); `hold` the request until `release()`; `then(request)` is called
        first. A fault of `hold` or `then` alone goes on to the service.
        """
        fault = Fault(path, **fields)
        with self._lock:
            self._plan.append(fault)
        return fault

    def remove(self, fault: Fault) -> None:
        """Remove a fault and release what it holds."""
        with self._lock:
            self._plan = [one for one in self._plan if one is not fault]
        fault.release()

    def clear(self) -> None:
        """Remove all faults."""
        for fault in list(self._plan):
            self.remove(fault)

    def wrap(self, service: str, application: Wsgi) -> Wsgi:
        """`application` behind the plan, with every request in the ledger."""

        def serve(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
            request = self.ledger.open(service, environ)
            with self._lock:
                fault = next((one for one in self._plan if one.strikes(environ, service)), None)

            def start(status: str, headers: list[tuple[str, str]], *exc_info: Any) -> Any:
                request.status = int(status.split(maxsplit=1)[0])
                for name in ("units", "bucket", "about"):
                    if f"sandbox.{name}" in environ:
                        setattr(request, name, environ[f"sandbox.{name}"])
                return start_response(status, headers, *exc_info)

            if fault is None:
                return application(environ, start)
            return _strike(fault, request, application, environ, start)

        return serve


def _strike(
    fault: Fault,
    request: LoggedRequest,
    application: Wsgi,
    environ: dict[str, Any],
    start: Callable[..., Any],
) -> Iterable[bytes]:
    if fault.then:
        fault.then(request)
    if fault.hold:
        fault.arrived.set()
        fault.released.wait()
    if fault.reset:
        _reset(environ)
    if fault.cut is not None:
        return _cut(application, environ, start, fault.cut, fault.honest)
    if fault.status is None:
        return application(environ, start)
    body = fault.body(environ) if callable(fault.body) else fault.body
    kind = "text/html; charset=utf-8"
    if isinstance(body, dict):
        body, kind = json.dumps(body), "application/json; charset=UTF-8"
    data = body.encode() if isinstance(body, str) else body
    headers = {"Content-Type": kind, "Content-Length": str(len(data)), **fault.headers}
    start(f"{fault.status} Fault", list(headers.items()))
    return [data]


def _reset(environ: dict[str, Any]) -> None:
    """Break the connection with RST, as a router or a crashed server does."""
    connection: socket.socket = environ["werkzeug.socket"]
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    os.close(connection.detach())
    raise ConnectionResetError("reset by the fault plan")


def _cut(
    application: Wsgi,
    environ: dict[str, Any],
    start: Callable[..., Any],
    fraction: float,
    honest: bool,
) -> Iterable[bytes]:
    answer: list[Any] = []

    def keep(status: str, headers: list[tuple[str, str]], *_: Any) -> Any:
        answer[:] = [status, headers]
        return lambda data: None

    body = b"".join(application(environ, keep))
    status, headers = answer
    data = body[: int(len(body) * fraction)]
    length = len(data) if honest else len(body)
    kept = [pair for pair in headers if pair[0].lower() != "content-length"]
    start(status, [*kept, ("Content-Length", str(length))])
    return [data]


class Sandbox(server.Sandbox):
    """The services behind one fault plan, with every request in the ledger."""

    known = server.SERVICES | {"zenodo": zenodo, "hub": hub}

    def __init__(self, *args: Any, **options: Any) -> None:
        self.faults = Faults()
        super().__init__(*args, **options)

    def mounted(self, name: str) -> Wsgi:
        return self.faults.wrap(name, self.applications[name])

    @property
    def ledger(self) -> Ledger:
        """Every request so far."""
        return self.faults.ledger

    def stop(self) -> None:
        """Release held requests and stop listening."""
        self.faults.clear()
        super().stop()
