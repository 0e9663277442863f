"""References to a place in a source, for `read`: a short ref, or the link of an answer.

youtube:VIDEO         youtube:VIDEO@61      a second of it
wiki:PAGE             wiki:PAGE#Taming      a section, by its anchor
reddit:POST           reddit:POST/COMMENT   bare ids
"""

import re
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

from kb.core.errors import UsageError
from kb.core.sources import SOURCES

_REF = re.compile(rf"({'|'.join(SOURCES)}):([^\s@#/]+)(?:[@#/](.+))?")


class SourceLocation(NamedTuple):
    """An item of a source, and a place in it; for a link to the wiki `key` is the page's URL."""

    source: str
    key: str
    at: str = ""

    @property
    def ref(self) -> str:
        """The reference, as `read` takes it."""
        mark = SOURCES[self.source].mark if self.at else ""
        return f"{self.source}:{self.key}{mark}{self.at}"


def from_link(url: str) -> SourceLocation | None:
    """The place of an answer's link; None for any other link."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https"):
        return None
    host = f".{parts.hostname or ''}"
    of_host = [source for source in SOURCES.values() if host.endswith(source.hosts or "-")]
    for source in of_host or [source for source in SOURCES.values() if not source.hosts]:
        if found := source.place_of(parts):
            return SourceLocation(source.name, *found)
    return None


def parse_reference(given: str) -> SourceLocation:
    """The place of a ref or link. Raises UsageError."""
    given = given.strip()
    if match := _REF.fullmatch(given):
        return SourceLocation(match[1], *SOURCES[match[1]].bare(match[2], match[3] or ""))
    if known := from_link(given):
        return known
    refs = ", ".join(source.ref for source in SOURCES.values() if source.ref)
    raise UsageError(
        f"invalid reference {given[:200]!r}", hint=f"give the ref or link of an answer: {refs}"
    )


def anchor(text: str) -> str:
    """An anchor in a comparable form: links percent-encode it."""
    return unquote(text).replace(" ", "_")
