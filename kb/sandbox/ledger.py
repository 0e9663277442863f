"""The request ledger of the sandbox: what was asked, and what it would have cost."""

from __future__ import annotations

import re
import threading
from dataclasses import asdict, dataclass, field
from time import time
from typing import Any
from urllib.parse import parse_qsl, urlencode

_SECRET = {"key", "access_token", "client_secret", "password", "refresh_token", "code"}


@dataclass
class LoggedRequest:
    """One request. `query` has no credentials; `about` is what the service says it was for (a video
    id …).
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
    fault: bool = False  # answered by the fault plan, the service never saw it
    args: dict[str, str] = field(default_factory=dict)


class Ledger:
    """Every request in the order of arrival; thread-safe."""

    def __init__(self) -> None:
        self._seen: list[LoggedRequest] = []
        self._lock = threading.Lock()

    def open(self, service: str, environ: dict[str, Any]) -> LoggedRequest:
        """Write down a request that has just come."""
        pairs = [
            pair
            for pair in parse_qsl(environ.get("QUERY_STRING", ""), keep_blank_values=True)
            if pair[0] not in _SECRET
        ]
        with self._lock:
            seen = LoggedRequest(
                number=len(self._seen),
                time=time(),
                service=service,
                method=environ["REQUEST_METHOD"],
                path=environ.get("PATH_INFO", ""),
                query=urlencode(pairs),
                agent=environ.get("HTTP_USER_AGENT", ""),
                args=dict(pairs),
            )
            self._seen.append(seen)
        return seen

    def requests(self, path: str = "", *, service: str = "", since: int = 0) -> list[LoggedRequest]:
        """Requests whose path matches the regular expression `path`, from number `since` on."""
        with self._lock:
            held = self._seen[since:]
        return [
            seen for seen in held if re.search(path, seen.path) and service in ("", seen.service)
        ]

    def units(self, bucket: str = "general", *, since: int = 0) -> int:
        """Quota units that the requests cost."""
        return sum(seen.units for seen in self.requests(since=since) if seen.bucket == bucket)

    def __len__(self) -> int:
        return len(self._seen)

    def as_json(self) -> list[dict[str, Any]]:
        """The ledger for a reader in another process."""
        return [asdict(seen) for seen in self.requests()]
