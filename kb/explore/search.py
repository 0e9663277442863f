"""Search, and what surrounds an answer: transcript, wiki page with its screenshot, thread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

from kb.core.errors import KbError, UsageError
from kb.core.sources import SOURCES
from kb.mcp.documents import AgentDocument, parse_reference, surroundings
from kb.mcp.search_tool import ref
from kb.reader.screenshots import stored_png
from kb.search.answers import MARK, NotIndexed, SearchHit, search, suggest
from kb.search.ranking import Only, day_given

LIMIT = 50  # answers
NEAREST = 40  # parts around the place
KINDS = ("video", "transcript", "section", "table", "post", "comment")
_FIELDS = ("words", "source", "kind", "entity", "since", "until", "least")


@dataclass(frozen=True)
class ShownHit:
    """An answer, the address of its surroundings, and its snippet in pieces: every second one is
    marked.
    """

    hit: SearchHit
    address: str
    pieces: list[str]


@dataclass(frozen=True)
class SearchPage:
    """What was asked, by the name of its field, and the answers, best first; or why there are none:
    `problem`, and a `hint` what to do.
    """

    asked: dict[str, str]
    hits: list[ShownHit]
    suggestion: str
    problem: str = ""
    hint: str = ""
    sources: tuple[str, ...] = tuple(SOURCES)
    kinds: tuple[str, ...] = KINDS

    @property
    def suggested(self) -> str:
        return f"/search?{urlencode({**self.asked, 'words': self.suggestion})}"


@dataclass(frozen=True)
class DocumentPage:
    """A document; `shown` are the numbers of the parts that the page has, `here` that of the place.

    `all` is the address of the page with every part, "" where it has all.
    """

    document: AgentDocument
    ref: str
    here: int
    shown: list[int]
    all: str


def read(root: Path, query: Mapping[str, str]) -> SearchPage:
    """The answers to an address; none without words, and none where the index is missing or out of
    date: it is not built here, as that could keep other commands from writing. Raises UsageError,
    DamagedData.
    """
    asked = _asked(query)
    if not asked["words"]:
        return SearchPage(asked, [], "")
    if asked["source"] not in ("", *SOURCES):
        raise UsageError(f"unknown source {asked['source']!r}")
    if asked["kind"] not in ("", *KINDS):
        raise UsageError(f"unknown kind {asked['kind']!r}")
    try:
        least = float(asked["least"] or 0)
    except ValueError:
        raise UsageError(f"the minimum score is {asked['least']!r}, not a number") from None
    only = Only(
        kinds=(asked["kind"],) if asked["kind"] else (),
        since=day_given("since", asked["since"]),
        until=day_given("until", asked["until"]),
        least=least,
        limit=LIMIT,
    )
    sources = [asked["source"]] if asked["source"] else []
    try:
        hits = search(root, asked["words"], sources=sources, only=only, entity=asked["entity"])
        meant = suggest(root, asked["words"], sources=sources)
    except NotIndexed as error:
        return without_answers(query, error)
    return SearchPage(asked, [_shown(hit) for hit in hits], meant)


def without_answers(query: Mapping[str, str], error: KbError) -> SearchPage:
    """The page of a question that has no answers for this reason."""
    return SearchPage(_asked(query), [], "", str(error), error.hint)


def _asked(query: Mapping[str, str]) -> dict[str, str]:
    return {name: query.get(name, "").strip() for name in _FIELDS}


def _shown(hit: SearchHit) -> ShownHit:
    pieces = hit.snippet.split(MARK)
    if len(pieces) % 2 == 0:  # the text has such a mark of its own
        pieces = [hit.snippet]
    return ShownHit(hit, f"/document?{urlencode({'ref': ref(hit)})}#here", pieces)


def document(root: Path, query: Mapping[str, str]) -> DocumentPage:
    """What stands around the place that an address names. Raises UsageError, DamagedData."""
    place = parse_reference(query.get("ref", ""))
    found = surroundings(root, place)
    number = len(found.parts) if query.get("all") else NEAREST
    more = "" if number >= len(found.parts) else f"?{urlencode({'ref': place.ref, 'all': 1})}#here"
    return DocumentPage(found, place.ref, found.nearest[0], sorted(found.nearest[:number]), more)


def screenshot(root: Path, query: Mapping[str, str]) -> bytes:
    """The PNG of the page that an address names. Raises UsageError, DamagedData."""
    shown = surroundings(root, parse_reference(query.get("ref", ""))).screenshot
    if shown is None:
        raise UsageError("the page has no screenshot")
    return stored_png(shown.home, shown.path)[0]
