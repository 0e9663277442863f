"""robots.txt, read once a host (RFC 9309)."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from protego import Protego

_GROUP = re.compile(r"^(\s*user-agent\s*:\s*)([a-z_*-]+).*$", re.IGNORECASE | re.MULTILINE)


class Robots:
    """What a host's robots.txt allows one agent.

    `agent` may be a whole User-Agent: groups are found by its product token alone ("lorecrawl"), as
    what stands behind it (a contact's address) is no name of ours.
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
