"""What goes wrong in the sandbox, on purpose: a plan of faults around every service, and the ledger
of requests.

    faults = Faults()
    faults.add("/youtube/v3/videos", status=503, times=2)          # the next two
    faults.add("/youtube/v3/videos", after=3, reset=True)          # the fourth: connection reset
    held = faults.add("/watch", hold=True); held.arrived.wait(); held.release()

A service is mounted as `faults.wrap("wiki", application)`. From another process the plan is set by
`POST /_sandbox/faults` (the arguments of `add` as JSON), cleared by DELETE, and the ledger is read
at `GET /_sandbox/requests`, on any service's port.
"""

from __future__ import annotations

import collections
import json
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

from kb.sandbox.ledger import Ledger, LoggedRequest

CONTROL = "/_sandbox/"
Wsgi = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]


@dataclass
class Fault:
    """One fault; `add` documents the fields. `hits` counts how often it struck."""

    path: str
    service: str = ""
    method: str = ""
    after: int = 0
    times: int | None = 1
    every: int = 1
    status: int | None = None
    body: bytes | str | dict[str, Any] | Callable[[dict[str, Any]], bytes] = b""
    headers: dict[str, str] = field(default_factory=dict)
    reset: bool = False
    cut: float | None = None
    honest: bool = False
    hold: bool = False
    burst: tuple[int, float] | None = None
    then: Callable[[LoggedRequest], None] | None = None
    when: Callable[[dict[str, Any]], bool] | None = None
    hits: int = 0
    matches: int = 0
    arrived: threading.Event = field(default_factory=threading.Event)
    _released: threading.Event = field(default_factory=threading.Event)
    _recent: collections.deque[float] = field(default_factory=collections.deque)

    def release(self) -> None:
        """Let held requests go on."""
        self._released.set()

    def strikes(self, environ: dict[str, Any], service: str) -> bool:
        """Whether this request is one of those meant. Called under the plan's lock."""
        target = f"{environ.get('PATH_INFO', '')}?{environ.get('QUERY_STRING', '')}"
        if self.service not in ("", service) or self.method not in ("", environ["REQUEST_METHOD"]):
            return False
        if not re.search(self.path, target) or (self.when and not self.when(environ)):
            return False
        self.matches += 1
        if self.times is not None and self.hits >= self.times:
            return False
        if self.matches <= self.after or (self.matches - self.after - 1) % self.every:
            return False
        if self.burst and not self._too_many(*self.burst):
            return False
        self.hits += 1
        return True

    def _too_many(self, most: int, seconds: float) -> bool:
        now = monotonic()
        while self._recent and self._recent[0] < now - seconds:
            self._recent.popleft()
        if len(self._recent) >= most:
            return True
        self._recent.append(now)
        return False


class Faults:
    """The plan and the ledger of one sandbox; thread-safe."""

    def __init__(self) -> None:
        self.ledger = Ledger()
        self._plan: list[Fault] = []
        self._lock = threading.Lock()

    def add(self, path: str = "", **what: Any) -> Fault:
        """Plan a fault for requests whose `path?query` matches the regular expression `path`.

        Which: `service`, `method`, `when(environ)`; skip the first `after` matches, then strike
        each `every`-th, `times` in all (None: without end); `burst=(n, seconds)` strikes only what
        comes beyond n requests in a window of that many seconds. What: `status`, `headers`, `body`
        (bytes, text, a dict sent as JSON, or a function of environ) instead of the service; `reset`
        the connection; `cut` the service's body to this fraction (`honest`: with a Content-Length
        that fits the cut body); `hold` the request until `release()`; `then(seen)` is called first.
        A fault of `hold` or `then` alone goes on to the service.
        """
        fault = Fault(path, **what)
        with self._lock:
            self._plan.append(fault)
        return fault

    def remove(self, fault: Fault) -> None:
        """Take a fault back; what it holds is released."""
        with self._lock:
            self._plan = [one for one in self._plan if one is not fault]
        fault.release()

    def clear(self) -> None:
        """Take everything back."""
        for fault in list(self._plan):
            self.remove(fault)

    def wrap(self, service: str, application: Wsgi) -> Wsgi:
        """`application` behind the plan, with every request in the ledger."""

        def serve(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
            if environ.get("PATH_INFO", "").startswith(CONTROL):
                return self._control(environ, start_response)
            seen = self.ledger.open(service, environ)
            with self._lock:
                fault = next((one for one in self._plan if one.strikes(environ, service)), None)

            def start(status: str, headers: list[tuple[str, str]], exc_info: Any = None) -> Any:
                seen.status = int(status.split(maxsplit=1)[0])
                for name in ("units", "bucket", "about"):
                    if f"sandbox.{name}" in environ:
                        setattr(seen, name, environ[f"sandbox.{name}"])
                return (
                    start_response(status, headers, exc_info)
                    if exc_info
                    else start_response(status, headers)
                )

            if fault is None:
                return application(environ, start)
            return self._strike(fault, seen, application, environ, start)

        return serve

    def _strike(
        self,
        fault: Fault,
        seen: LoggedRequest,
        application: Wsgi,
        environ: dict[str, Any],
        start: Callable[..., Any],
    ) -> Iterable[bytes]:
        if fault.then:
            fault.then(seen)
        if fault.hold:
            fault.arrived.set()
            fault._released.wait()
        if fault.reset:
            seen.fault = True
            _reset(environ)
        if fault.cut is not None:
            return _cut(application, environ, start, fault.cut, fault.honest)
        if fault.status is None:
            return application(environ, start)
        seen.fault = True
        body = fault.body(environ) if callable(fault.body) else fault.body
        kind = (
            "application/json; charset=UTF-8"
            if isinstance(body, dict)
            else "text/html; charset=utf-8"
        )
        data = (
            json.dumps(body).encode()
            if isinstance(body, dict)
            else body.encode()
            if isinstance(body, str)
            else body
        )
        start(
            f"{fault.status} Fault",
            [("Content-Type", kind), ("Content-Length", str(len(data))), *fault.headers.items()],
        )
        return [data]

    def _control(self, environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        what, method = environ["PATH_INFO"].removeprefix(CONTROL), environ["REQUEST_METHOD"]
        answer: Any = {"ok": True}
        if (what, method) == ("faults", "POST"):
            given: dict[str, Any] = json.loads(
                environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0)) or b"{}"
            )
            if "burst" in given:
                given["burst"] = tuple(given["burst"])
            self.add(**given)
        elif (what, method) == ("faults", "DELETE"):
            self.clear()
        elif (what, method) == ("requests", "GET"):
            answer = self.ledger.as_json()
        else:
            answer = {"error": "POST or DELETE /_sandbox/faults, GET /_sandbox/requests"}
        data = json.dumps(answer).encode()
        start("200 OK", [("Content-Type", "application/json"), ("Content-Length", str(len(data)))])
        return [data]


def _reset(environ: dict[str, Any]) -> None:
    """Break the connection with RST, as a router or a crashed server does."""
    connection: socket.socket = environ["werkzeug.socket"]
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    os.close(connection.detach())
    raise ConnectionResetError("reset by the fault plan")


def _cut(
    application: Wsgi, environ: dict[str, Any], start: Callable[..., Any], part: float, honest: bool
) -> Iterable[bytes]:
    held: list[Any] = []

    def keep(status: str, headers: list[tuple[str, str]], exc_info: Any = None) -> Any:
        held[:] = [status, headers]
        return lambda data: None

    whole = b"".join(application(environ, keep))
    status, headers = held
    data = whole[: int(len(whole) * part)]
    length = len(data) if honest else len(whole)
    start(
        status,
        [(name, value) for name, value in headers if name.lower() != "content-length"]
        + [("Content-Length", str(length))],
    )
    return [data]
