"""How much of an answer is read, and for how long: a service decides neither.

A body is read in parts and given up beyond a number of decoded bytes. The whole answer, headers
included, has to come within a time: then, or some seconds after a signal asked us to stop, the
connection is shut down, which ends a read that waits for the next byte.
"""

import contextlib
import socket
import threading
from collections.abc import Iterator
from typing import Any

import requests
import urllib3
from urllib3.connection import HTTPConnection, HTTPSConnection

from kb.core import clock, signals
from kb.net import limits

_STOP_S = 3.0  # for the answer in hand, once we were asked to stop
_LOOK_S = 0.5
PART = 1 << 16


class TooLarge(requests.RequestException):
    """An answer has more bytes than are read."""


class TooSlow(requests.Timeout):
    """An answer was not there in time."""


class _Watch:
    """The connections whose answers are awaited; a thread shuts down those that take too long."""

    def __init__(self) -> None:
        self._ends: dict[int, tuple[socket.socket, float]] = {}
        self._late: set[int] = set()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    @contextlib.contextmanager
    def over(self, sock: socket.socket | None, seconds: float) -> Iterator[None]:
        """Watch a connection during the block. Raises TooSlow, and Interrupted where we were asked
        to stop.
        """
        if sock is None:  # closed: what is left of the answer is here
            yield
            return
        key = id(sock)
        with self._lock:
            self._ends[key] = sock, clock.monotonic() + seconds
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._shut_late, daemon=True)
                self._thread.start()
        try:
            yield
        except Exception as error:
            if key in self._late:
                signals.stop.raise_if_asked()
                raise TooSlow(f"no whole answer within {seconds:.0f} s") from error
            raise
        finally:
            with self._lock:
                self._ends.pop(key, None)
                late = key in self._late
                self._late.discard(key)
        if late:  # it looked like the end of the body
            signals.stop.raise_if_asked()
            raise TooSlow(f"no whole answer within {seconds:.0f} s")

    def _shut_late(self) -> None:
        asked: float | None = None
        while True:
            threading.Event().wait(_LOOK_S)
            now = clock.monotonic()
            asked = (now if asked is None else asked) if signals.stop.requested() else None
            with self._lock:
                if not self._ends:
                    self._thread = None
                    return
                for key, (sock, end) in self._ends.items():
                    if now > end or (asked is not None and now > asked + _STOP_S):
                        self._late.add(key)
                        with contextlib.suppress(OSError):
                            # Below TLS, whose own end would wait for the other side.
                            socket.socket.shutdown(sock, socket.SHUT_RDWR)


_watch = _Watch()


class _Watched(HTTPConnection):
    """Status line and headers come within the time of a whole answer."""

    def getresponse(self) -> Any:
        """The answer, with the connection's socket as `watched`."""
        sock = self.sock
        try:
            with _watch.over(sock, limits.ANSWER_S):
                response = super().getresponse()
        except TooSlow as error:
            raise TimeoutError(str(error)) from error  # what urllib3 takes for one of its own
        response.watched = sock  # type: ignore[attr-defined]
        return response


class _WatchedTls(_Watched, HTTPSConnection):
    """The same over TLS."""


class _Pool(urllib3.HTTPConnectionPool):
    ConnectionCls = _Watched


class _TlsPool(urllib3.HTTPSConnectionPool):
    ConnectionCls = _WatchedTls


def watched(manager: urllib3.PoolManager) -> urllib3.PoolManager:
    """The same manager, whose connections are watched."""
    manager.pool_classes_by_scheme = {"http": _Pool, "https": _TlsPool}
    return manager


def parts(response: requests.Response, *, most: int, seconds: float) -> Iterator[bytes]:
    """The decoded body, part by part. Raises TooLarge, TooSlow, Interrupted, and what requests
    raises for an answer that breaks off.
    """
    size = 0
    with _watch.over(getattr(response.raw, "watched", None), seconds):
        for part in response.iter_content(PART):
            size += len(part)
            if size > most:
                response.close()
                raise TooLarge(f"an answer of more than {most:,} bytes")
            yield part


def read_body(response: requests.Response) -> None:
    """Read the whole body, which is the response's `content` from then on. Raises as `parts`."""
    body = bytearray()
    try:
        for part in parts(response, most=limits.ANSWER_BYTES, seconds=limits.ANSWER_S):
            body += part
        response._content = bytes(body)
    finally:
        body.clear()  # an error keeps the frames that it came through
