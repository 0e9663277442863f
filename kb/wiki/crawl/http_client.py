"""Requests from the wiki's hosts over plain HTTP: API, robots.txt and image files."""

from __future__ import annotations

import hashlib
import math
import re
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit, urlunsplit

import requests
from protego import Protego

from kb.core import clock
from kb.core.config.addresses import is_loopback
from kb.core.context import Run
from kb.core.errors import Challenged, ItemFinal, Retryable
from kb.net import bounded, limits, retry
from kb.net.rate import Pace
from kb.net.retry import Note
from kb.net.session import (
    PRODUCT,
    HttpSession,
    Ledger,
    PerThread,
    failure,
    host_of,
    send,
    user_agent,
)
from kb.store.rawlog import sidefiles
from kb.wiki.errors import NotAnImage, of_status, turned_away

_GROUP = re.compile(r"^(\s*user-agent\s*:\s*)([a-z_*-]+).*$", re.IGNORECASE | re.MULTILINE)


class Robots:
    """What a host's robots.txt allows one agent.

    `agent` may be a whole User-Agent: groups are found by its product token alone ("lorecrawl"), as
    what stands behind it (a contact's address) is not the crawler's name.
    """

    def __init__(self, text: str, agent: str) -> None:
        self._agent = re.split(r"[/\s]", agent, maxsplit=1)[0].lower()
        self._rules = Protego.parse(_GROUP.sub(r"\1\2", text))
        # Whether a group is written for us by name.
        self.named = any(group[1].lower() == self._agent for group in _GROUP.findall(text))

    @classmethod
    def of_answer(cls, status: int, text: str, agent: str) -> Robots:
        """By the answer for /robots.txt: 4xx allows everything,
        5xx forbids everything (RFC 9309, 2.3.1).
        """
        if 200 <= status < 300:
            return cls(text, agent)
        return cls("User-agent: *\nDisallow: /" if status >= 500 else "", agent)

    def allows(self, url: str) -> bool:
        """Whether the agent may ask for `url`."""
        return bool(self._rules.can_fetch(url, self._agent))

    @property
    def crawl_delay(self) -> float | None:
        """Seconds between two requests, when the host asks for that."""
        delay = self._rules.crawl_delay(self._agent)
        return None if delay is None else float(delay)


def robots_url(url: str) -> str:
    """Where the rules for `url` are."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc}/robots.txt"


Result = TypeVar("Result")
TRIES = 6
# Headers of answers that are challenges: Cloudflare's
# (https://developers.cloudflare.com/cloudflare-challenges/challenge-types/challenge-pages/detect-response/)
# and AWS WAF's (https://docs.aws.amazon.com/waf/latest/developerguide/waf-captcha-and-challenge-how-it-works.html).
_CHALLENGES = ("cf-mitigated", "x-amzn-waf-action")
FILE_PAUSE = 0.1
ROBOTS_BYTES = 500 << 10  # of a robots.txt that are read (RFC 9309, 2.5)


class WikiHosts:
    """The hosts of one wiki. Thread-safe. Only `root` and `hosts` are ever requested."""

    def __init__(
        self, run: Run, root: str, hosts: tuple[str, ...], pause: float, tries: int = 0
    ) -> None:
        self._tries = tries or TRIES
        self.agent = user_agent(run.settings.kb_contact)
        self.run, self.root = run, root
        schemes = {"https", urlsplit(root).scheme}
        self._hosts = {host_of(root)} | {
            f"{scheme}://{host}".lower() for host in hosts for scheme in schemes
        }
        self._sessions = PerThread(self._session)
        self._robots: Robots | None = None
        # On loopback only the limits that the service announces apply.
        self.pace = Pace(0.0 if is_loopback(root) else pause)
        self._files = Pace(0.0 if is_loopback(root) else min(pause, FILE_PAUSE))
        self._counting = threading.Lock()
        self.requests = 0
        self.foreign_robots = False  # robots.txt was answered with a page, as challenges do
        self.ledger: Ledger | None = None  # set as soon as the data root is open
        self.sleep: Callable[[float], None] = clock.sleep  # between two tries

    def rebase_loopback(self, url: str) -> str:
        """A recorded URL as it is reached now.

        Services on loopback use another port each time, so the current root's port replaces the
        recorded one. Other URLs stay as they are.
        """
        parts = urlsplit(url)
        if host_of(url) in self._hosts or not (is_loopback(self.root) and is_loopback(url)):
            return url
        return urlunsplit(parts._replace(netloc=urlsplit(self.root).netloc))

    # -- robots ----------------------------------------------------------------------------------

    def read_robots(self) -> None:
        """Fetch robots.txt once; its crawl-delay becomes the pace. Raises Unreachable."""
        try:
            answer = self.attempt(
                lambda: self._fetch(robots_url(self.root), {}), service="the wiki"
            )
            self.foreign_robots = answer.content.lstrip()[:1] == b"<"
            text = answer.content[:ROBOTS_BYTES].decode("utf-8", "replace")
            self._robots = Robots.of_answer(answer.status_code, text, self.agent)
        except ItemFinal:
            self._robots = Robots.of_answer(404, "", self.agent)
        self.pace.at_least(self._robots.crawl_delay or 0.0)

    def allowed(self, url: str) -> bool:
        """Whether robots.txt allows a URL."""
        return self._robots is None or self._robots.allows(url)

    def barred(self, url: str) -> None:
        """Raise Challenged when robots.txt names us and bars the front page or the API."""
        if self._robots is not None and self._robots.named and not self._robots.allows(url):
            raise Challenged(
                f"the wiki's robots.txt names {PRODUCT} and bars {url}",
                hint="ask the wiki's operators for permission",
            )

    # -- requests --------------------------------------------------------------------------------

    def get(self, url: str, params: Mapping[str, str | int]) -> requests.Response:
        """One paced request. Raises Retryable, ItemFinal or Challenged."""
        self.pace.wait()
        return self._fetch(url, params)

    def attempt(self, call: Callable[[], Result], *, service: str | None = None) -> Result:
        """Retry `call` with growing pauses, honouring Retry-After.

        After the last try raises Blocked, or Retryable: the item failed. With `service` the answer
        is indispensable, and Unreachable is raised.
        """
        patience = math.inf if self.run.wait else retry.PATIENCE_S
        return retry.attempt(
            call, tries=self._tries, patience=patience, service=service, sleep=self.sleep
        )

    def rest(self, after: float | None) -> None:
        """Pause all threads for a Retry-After of so many seconds.

        One that exceeds our patience ends the run instead (`attempt`).
        """
        if after is not None and (self.run.wait or after <= retry.PATIENCE_S):
            self.pace.rest(after)

    def turn(self, after: float | None, within: float) -> bool:
        """Wait until another request may be sent; False when that exceeds `within` seconds."""
        self.rest(after)
        return (after or 0.0) <= within and self.pace.wait_within(within)

    def close(self) -> None:
        """Close the connections."""
        self._sessions.close()

    def _session(self) -> HttpSession:
        return HttpSession(
            self.run.settings,
            hosts=self._hosts,
            ledger=self._count,
            stray=lambda url: ItemFinal("redirected_away", url),
        )

    def _count(self, request: requests.PreparedRequest) -> Note | None:
        with self._counting:
            self.requests += 1
        return self.ledger(request) if self.ledger else None

    def _fetch(
        self, url: str, params: Mapping[str, str | int], *, stream: bool = False
    ) -> requests.Response:
        if host_of(url) not in self._hosts:
            raise ItemFinal("other_host", urlsplit(url).netloc)
        try:
            response = send(self._sessions.session, "GET", url, params=params, stream=stream)
        except Retryable as error:
            self.rest(error.after)
            raise
        if any(name in response.headers for name in _CHALLENGES):
            response.close()
            raise turned_away(f"the wiki's front end answers {url} with a challenge")
        if response.status_code >= 400:
            response.close()
            raise of_status(response.status_code)
        return response

    def check_file(self, url: str) -> None:
        """Ask for an image file to see whether it is served, without reading it.

        Raises NotAnImage for a page in its place, and as `get` does.
        """
        self._files.wait()
        with self._fetch(url, {}, stream=True) as response:
            if _media_type(response) == "text/html":
                raise NotAnImage

    def download(
        self, url: str, folder: Path, limit: int, inspect: Callable[[bytes], Any]
    ) -> tuple[str, Any, int]:
        """Download an image file into `folder`, named by its SHA-256.

        Returns (SHA-256, result of `inspect`, bytes). An intact file that exists already is not
        written again. Raises ItemFinal("too_large"), ItemFinal("not_a_picture"), NotAnImage or
        Retryable.
        """
        self._files.wait()
        data, content = b"", bytearray()
        try:
            with self._fetch(url, {}, stream=True) as response:
                wanted = response.headers.get("content-length", "")
                if re.fullmatch("[0-9]{1,18}", wanted) and int(wanted) > limit:
                    raise ItemFinal("too_large", wanted)
                try:
                    for part in bounded.parts(response, most=limit, seconds=limits.ANSWER_S):
                        content += part
                except bounded.TooLarge:
                    raise ItemFinal("too_large", f"more than {limit}") from None
                except requests.RequestException as error:
                    raise failure(error, url) from None
            data = bytes(content)
            content.clear()
            image = inspect(data)
            if image is None:
                if _media_type(response) == "text/html":
                    raise NotAnImage
                raise ItemFinal("not_a_picture")
            name = hashlib.sha256(data).hexdigest()
            sidefiles.write_named(folder / f"{name}.{image.extension}", data)
            return name, image, len(data)
        finally:
            content.clear()  # an error keeps the frames that it came through
            data = b""


def _media_type(response: requests.Response) -> str:
    return response.headers.get("content-type", "").partition(";")[0].strip().lower()
