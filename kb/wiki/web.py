"""The wiki over plain HTTP: its API, its robots.txt and its picture files, by the project's HTTP policy."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from kb import __version__
from kb.core import clock
from kb.core.errors import Blocked, ItemFinal, Retryable, Unreachable
from kb.store.atomic import writing

Result = TypeVar("Result")
TRIES = 6
TIMEOUT = (10, 60)


@dataclass(frozen=True)
class Answer:
    """A whole answer. `after` is the Retry-After in seconds, when the server gave one."""

    status: int
    body: bytes
    url: str
    after: float | None


def user_agent(contact: str) -> str:
    """Who asks, in every request and in the browser."""
    return f"lorebase/{__version__} (+{contact})"


class Pace:
    """At least `seconds` between the starts of any two requests, over all threads."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._next, self._lock = seconds, 0.0, threading.Lock()

    def at_least(self, seconds: float) -> None:
        """Never faster than this."""
        self._seconds = max(self._seconds, seconds)

    def wait(self) -> None:
        """Wait for one's turn."""
        with self._lock:
            start = max(clock.monotonic(), self._next)
            self._next = start + self._seconds
        clock.sleep(start - clock.monotonic())


class Web:
    """One wiki's hosts. Thread-safe. `hosts` are the only ones that are ever asked."""

    def __init__(self, root: str, contact: str, hosts: tuple[str, ...], *, pause: float, seed: int = 0) -> None:
        import requests

        self.agent = user_agent(contact)
        self._session = requests.Session()
        self._session.trust_env = False
        self._session.headers["User-Agent"] = self.agent
        self._hosts = {urlsplit(root).netloc, *hosts}
        self._root, self._seed = root, seed
        self._robots: Any = None
        self.requests = 0
        self.pace = Pace(pause)

    # -- robots ----------------------------------------------------------------------------------

    def read_robots(self) -> None:
        """Fetch robots.txt once; its crawl-delay becomes the pace."""
        from protego import Protego

        try:
            answer = self.attempt(lambda: self._fetch(f"{self._root}/robots.txt", {}))
            text = answer.body.decode("utf-8", "replace")
        except ItemFinal:
            text = ""  # 4xx: there are no rules (RFC 9309, 2.3.1.3)
        self._robots = Protego.parse(text)
        delay = self._robots.crawl_delay(self.agent)
        if delay:
            self.pace.at_least(float(delay))

    def allowed(self, url: str) -> bool:
        """Whether robots.txt lets us read an address."""
        return self._robots is None or self._robots.can_fetch(url, self.agent)

    # -- requests --------------------------------------------------------------------------------

    def get(self, url: str, params: dict[str, str]) -> Answer:
        """One paced request. Raises Retryable or ItemFinal."""
        self.pace.wait()
        return self._fetch(url, params)

    def attempt(self, call: Callable[[], Result]) -> Result:
        """`call` with tries, growing pauses and the server's own wish. Raises Unreachable or Blocked at the end."""
        random = clock.rng(self._seed, "wiki", self.requests)
        for number in range(1, TRIES + 1):
            try:
                return call()
            except Retryable as error:
                if number == TRIES:
                    if error.reason == "http_429":
                        raise Blocked("the wiki answers 429 without end", hint="wait and run the same command again") from None
                    raise Unreachable(f"the wiki can't be reached: {error.reason}", hint="run the same command to go on") from None
                clock.sleep(error.after if error.after is not None else min(30.0, 0.25 * 2**number) * random.uniform(0.5, 1))
        raise AssertionError("unreachable")

    def _fetch(self, url: str, params: dict[str, str]) -> Answer:
        with self._open(url, params, stream=False) as response:
            return Answer(response.status_code, response.content, response.url, _after(response))

    def _open(self, url: str, params: dict[str, str], *, stream: bool) -> Any:
        import requests

        if urlsplit(url).netloc not in self._hosts:
            raise ItemFinal("other_host", urlsplit(url).netloc)
        self.requests += 1
        try:
            response = self._session.get(url, params=params, timeout=TIMEOUT, stream=stream, allow_redirects=False)
            for _ in range(5):
                if not response.is_redirect:
                    break
                target = requests.compat.urljoin(response.url, response.headers["location"])
                response.close()
                if urlsplit(target).netloc not in self._hosts:
                    raise ItemFinal("redirected_away", target)
                response = self._session.get(target, timeout=TIMEOUT, stream=stream, allow_redirects=False)
        except (requests.ConnectionError, requests.Timeout, requests.exceptions.ChunkedEncodingError) as error:
            raise Retryable(type(error).__name__, unreachable=True) from None
        except requests.RequestException as error:
            raise ItemFinal("bad_address", type(error).__name__) from None
        if response.status_code == 429 or response.status_code >= 500:
            response.close()
            raise Retryable(f"http_{response.status_code}", after=_after(response), unreachable=response.status_code != 429)
        if response.status_code >= 400:
            response.close()
            raise ItemFinal(f"http_{response.status_code}")
        return response

    def download(self, url: str, folder: Path, limit: int, inspect: Callable[[bytes], Any]) -> tuple[str, Any, int]:
        """A picture file into `folder`, named by its SHA-256: (sha256, what `inspect` said, bytes).

        Raises ItemFinal("too_large"), ItemFinal("not_a_picture") or Retryable. A file that is
        there already is not written again.
        """
        import requests

        held, digest = bytearray(), hashlib.sha256()
        with self._open(url, {}, stream=True) as response:
            wanted = response.headers.get("content-length")
            if wanted and wanted.isdigit() and int(wanted) > limit:
                raise ItemFinal("too_large", wanted)
            try:
                for part in response.iter_content(1 << 16):
                    held += part
                    digest.update(part)
                    if len(held) > limit:
                        raise ItemFinal("too_large", f"more than {limit}")
            except requests.RequestException as error:
                raise Retryable(type(error).__name__, unreachable=True) from None
            if wanted and wanted.isdigit() and not response.headers.get("content-encoding") and len(held) != int(wanted):
                raise Retryable("cut_off", unreachable=True)
        data = bytes(held)
        found = inspect(data)
        if found is None:
            raise ItemFinal("not_a_picture")
        path = folder / f"{digest.hexdigest()}.{found.extension}"
        if not path.exists():
            with writing(path) as temporary:
                temporary.write_bytes(data)
        return digest.hexdigest(), found, len(data)


def _after(response: Any) -> float | None:
    """Retry-After in seconds; a date counts from now."""
    value = (response.headers.get("retry-after") or "").strip()
    if value.isdigit():
        return float(value)
    if not value:
        return None
    from email.utils import parsedate_to_datetime

    try:
        return max(0.0, (parsedate_to_datetime(value) - clock.now()).total_seconds())
    except (ValueError, TypeError):
        return None
