"""References to a place in a source, for `read`: a short ref, or the link of an answer.

youtube:VIDEO         youtube:VIDEO@61      a second of it
wiki:PAGE             wiki:PAGE#Taming      a section, by its anchor
reddit:POST           reddit:POST/COMMENT   bare ids
"""

import re
from typing import NamedTuple
from urllib.parse import parse_qs, unquote, urlsplit

from kb.core.errors import UsageError
from kb.core.source_spec import load_name
from kb.core.sources import SOURCES

AGENTS = {name: source.agent for name, source in SOURCES.items() if source.agent is not None}
_REF = re.compile(rf"({'|'.join(AGENTS)}):([^\s@#/]+)(?:[@#/](.+))?")


class SourceLocation(NamedTuple):
    """An item of a source, and a place in it; for a link to the wiki `key` is the page's URL."""

    source: str
    key: str
    at: str = ""

    @property
    def ref(self) -> str:
        """The reference, as `read` takes it."""
        between = AGENTS[self.source].between if self.at else ""
        return f"{self.source}:{self.key}{between}{self.at}"


def from_link(url: str) -> SourceLocation | None:
    """The place of an answer's link; None for any other link."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https"):
        return None
    host = f".{parts.hostname or ''}"
    of_host = [name for name, agent in AGENTS.items() if host.endswith(agent.hosts or "-")]
    of_any = [name for name, agent in AGENTS.items() if not agent.hosts]
    for name in of_host or of_any:
        known: SourceLocation | None = load_name(AGENTS[name].link)(parts, parse_qs(parts.query))
        return known
    return None


def parse_reference(given: str) -> SourceLocation:
    """The place of a ref or link. Raises UsageError."""
    given = given.strip()
    if match := _REF.fullmatch(given):
        source, key, at = match[1], match[2], match[3] or ""
        key_prefix, at_prefix = AGENTS[source].prefixes
        return SourceLocation(source, key.removeprefix(key_prefix), at.removeprefix(at_prefix))
    if known := from_link(given):
        return known
    refs = ", ".join(agent.ref for agent in AGENTS.values())
    raise UsageError(
        f"invalid reference {given[:200]!r}", hint=f"give the ref or link of an answer: {refs}"
    )


def anchor(text: str) -> str:
    """An anchor in a comparable form: links percent-encode it."""
    return unquote(text).replace(" ", "_")
