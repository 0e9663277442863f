"""What names a place in a source, for `read`: a short ref of ours, or the link of an answer.

youtube:VIDEO         youtube:VIDEO@61      a second of it
wiki:PAGE             wiki:PAGE#Taming      a section, by its anchor
reddit:POST           reddit:POST/COMMENT   bare ids
"""

from __future__ import annotations

import re
from typing import NamedTuple
from urllib.parse import parse_qs, unquote, urlsplit

from kb.core.errors import UsageError
from kb.core.sources import SPECS

AGENTS = {name: spec.agent for name, spec in SPECS.items() if spec.agent is not None}
_REF = re.compile(rf"({'|'.join(AGENTS)}):([^\s@#/]+)(?:[@#/](.+))?")


class SourceLocation(NamedTuple):
    """A thing of a source, and where in it; `key` is the page's address for a link to the wiki."""

    source: str
    key: str
    at: str = ""

    @property
    def ref(self) -> str:
        """As it is given to `read`."""
        between = AGENTS[self.source].between if self.at else ""
        return f"{self.source}:{self.key}{between}{self.at}"


def of_link(url: str) -> SourceLocation | None:
    """The place that a link of an answer leads to; None for another link."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https"):
        return None
    host = f".{parts.hostname or ''}"
    of_host = [name for name, agent in AGENTS.items() if host.endswith(agent.hosts or "-")]
    of_any = [name for name, agent in AGENTS.items() if not agent.hosts]
    for name in of_host or of_any:
        known: SourceLocation | None = SPECS[name].load(AGENTS[name].link)(
            parts, parse_qs(parts.query)
        )
        return known
    return None


def place(given: str) -> SourceLocation:
    """The place of a ref or link. Raises UsageError."""
    given = given.strip()
    if match := _REF.fullmatch(given):
        source, key, at = match[1], match[2], match[3] or ""
        key_prefix, at_prefix = AGENTS[source].prefixes
        return SourceLocation(source, key.removeprefix(key_prefix), at.removeprefix(at_prefix))
    if known := of_link(given):
        return known
    refs = ", ".join(agent.ref for agent in AGENTS.values())
    raise UsageError(
        f"no place {given[:200]!r}", hint=f"give the ref or the link of an answer: {refs}"
    )


def anchor(text: str) -> str:
    """An anchor to compare by: links write it in per cents."""
    return unquote(text).replace(" ", "_")
