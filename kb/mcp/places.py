"""What names a place in a source, for `read`: a short ref of ours, or the link of an answer.

youtube:VIDEO         youtube:VIDEO@61      a second of it
wiki:PAGE             wiki:PAGE#Taming      a section, by its anchor
reddit:POST           reddit:POST/COMMENT   bare ids
"""

from __future__ import annotations

import re
from typing import NamedTuple
from urllib.parse import parse_qs, unquote, urlsplit, urlunsplit

from kb.core.errors import UsageError

_REF = re.compile(r"(youtube|wiki|reddit):([^\s@#/]+)(?:[@#/](.+))?")
_THREAD = re.compile(r"/comments/(\w+)(?:/[^/]*/(\w+))?")


class SourceLocation(NamedTuple):
    """A thing of a source, and where in it; `key` is the page's address for a link to the wiki."""

    source: str
    key: str
    at: str = ""

    @property
    def ref(self) -> str:
        """As it is given to `read`."""
        between = {"youtube": "@", "wiki": "#", "reddit": "/"}[self.source]
        return f"{self.source}:{self.key}{between}{self.at}" if self.at else self._thing

    @property
    def _thing(self) -> str:
        return f"{self.source}:{self.key}"


def of_link(url: str) -> SourceLocation | None:
    """The place that a link of an answer leads to; None for another link."""
    parts = urlsplit(url)
    host, asked = (parts.hostname or "").removeprefix("www."), parse_qs(parts.query)
    if parts.scheme not in ("http", "https"):
        return None
    if host == "youtube.com" and asked.get("v"):
        return SourceLocation("youtube", asked["v"][0], asked.get("t", [""])[0].removesuffix("s"))
    if host.endswith("reddit.com"):
        match = _THREAD.search(parts.path)
        return SourceLocation("reddit", match[1], match[2] or "") if match else None
    query = "&".join(one for one in parts.query.split("&") if not one.startswith("oldid="))
    return SourceLocation(
        "wiki", urlunsplit(parts._replace(query=query, fragment="")), parts.fragment
    )


def place(given: str) -> SourceLocation:
    """The place of a ref or link. Raises UsageError."""
    given = given.strip()
    if match := _REF.fullmatch(given):
        source, key, at = match[1], match[2], match[3] or ""
        if source == "reddit":
            key, at = key.removeprefix("t3_"), at.removeprefix("t1_")
        return SourceLocation(source, key, at)
    if known := of_link(given):
        return known
    raise UsageError(
        f"no place {given[:200]!r}",
        hint="give the ref or the link of an answer: youtube:VIDEO@61, wiki:PAGE#Section,"
        " reddit:POST/COMMENT",
    )


def anchor(text: str) -> str:
    """An anchor to compare by: links write it in per cents."""
    return unquote(text).replace(" ", "_")
