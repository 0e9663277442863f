"""`read`: a place and its surroundings, from the clean or restored tables.

A place has a short ref, or is the link of an answer:

youtube:VIDEO         youtube:VIDEO@61      a second of it
wiki:PAGE             wiki:PAGE#Taming      a section, by its anchor
reddit:POST           reddit:POST/COMMENT   bare ids

A document's parts keep their order: windows of a transcript, sections of a page with their tables,
a post and its comments. The part at the place is chosen first, then the nearest ones.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import quote, unquote, urlsplit

from kb.artifacts import table_catalog
from kb.core.errors import UsageError
from kb.core.sources import SOURCES, position
from kb.mcp.untrusted_text import AnswerPart, Fence
from kb.reader.tables import OpenTables
from kb.reader.wiki_page import Box
from kb.store.tables.remote_files import RemoteFolder

_REF = re.compile(rf"({'|'.join(SOURCES)}):([^\s@#/]+)(?:[@#/](.+))?")


class SourceLocation(NamedTuple):
    """An item of a source, and a place in it; for a link to the wiki `key` is the page's URL."""

    source: str
    key: str
    at: str = ""

    @property
    def ref(self) -> str:
        """The reference, as `read` takes it; the key as in an address, as it may be any text."""
        source = SOURCES[self.source]
        key, at = source.with_prefixes(self.key, self.at)
        return f"{self.source}:{quote(key, safe='')}{source.mark if at else ''}{at}"


def from_link(url: str) -> SourceLocation | None:
    """The place of an answer's link; None for any other link."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https"):
        return None
    host = f".{parts.hostname or ''}"
    of_host = [source for source in SOURCES.values() if host.endswith(source.hosts or "-")]
    for source in of_host or [source for source in SOURCES.values() if not source.hosts]:
        if place := position(parts, source.name):
            return SourceLocation(source.name, *place)
    return None


def parse_reference(given: str) -> SourceLocation:
    """The place of a ref or link. Raises UsageError."""
    given = given.strip()
    if match := _REF.fullmatch(given):
        source = SOURCES[match[1]]
        return SourceLocation(match[1], *source.without_prefixes(unquote(match[2]), match[3] or ""))
    if known := from_link(given):
        return known
    refs = ", ".join(source.ref for source in SOURCES.values() if source.ref)
    raise UsageError(
        f"invalid reference {given[:200]!r}", hint=f"give the ref or link of an answer: {refs}"
    )


def anchor(text: str) -> str:
    """An anchor in a comparable form: links percent-encode it."""
    return unquote(text).replace(" ", "_")


class DocumentBlock(NamedTuple):
    """A paragraph, heading, image or table of a part, and where the screenshot shows it.

    `level` is that of a heading, `cells` are rows of (text, is a header, columns, rows) of a table.
    """

    number: int
    text: str
    level: int | None = None
    cells: Sequence[Sequence[tuple[str, bool, int, int]]] = ()
    box: Box | None = None


class DocumentPart(NamedTuple):
    """A part of a document: its place and text, and its blocks where a page shows it."""

    place: SourceLocation
    label: str
    url: str
    text: str
    blocks: Sequence[DocumentBlock] = ()


class DocumentScreenshot(NamedTuple):
    """Where a screenshot is, as kb.artifacts.stored_files.stored_file takes it; its size, and the
    boxes of what stands at the place, in CSS pixels.
    """

    home: Path | RemoteFolder
    path: str
    width: float
    height: float
    boxes: list[Box]


class TreeLine(NamedTuple):
    """A line of what something is made of: how deep it stands, its words, and the document of it,
    "" where there is none.
    """

    level: int
    words: str
    ref: str = ""


class AgentDocument(NamedTuple):
    """A document in parts; `nearest` has their numbers, from the place outward. `made_of` is what
    its subject is made of, as far as the document's source knows it.
    """

    facts: str
    title: str
    parts: list[DocumentPart]
    nearest: list[int]
    screenshot: DocumentScreenshot | None = None
    made_of: Sequence[TreeLine] = ()


class DocumentReader(Protocol):
    """A source whose places can be read."""

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        """What stands around a place. Raises UsageError for an unknown one, DamagedData."""


Readers = Mapping[str, DocumentReader]


def surroundings(root: Path, place: SourceLocation, readers: Readers) -> AgentDocument:
    """The document of a place. Raises UsageError for an unknown place, DamagedData."""
    if not SOURCES[place.source].ref:
        raise UsageError(f"`read` does not support {place.source}", hint="use `query`")
    tables = OpenTables([table_catalog.read_catalog(root)])
    return readers[place.source].document(tables, place)


def run_read(root: Path, place: SourceLocation, size: int, readers: Readers) -> str:
    """The place and its surroundings, in at most `size` characters. Raises KbError."""
    document = surroundings(root, place, readers)
    fence = Fence()
    head = f"{fence.note}\n{document.facts}"
    answer_parts = [
        AnswerPart(f"[{part.label}] {part.url}", part.text or "(no text)")
        for part in document.parts
    ]
    title = fence.mark(document.title)
    room = size - len(head) - len(title) - 4
    reserve = len(_left(document, set())) + 40
    if room < reserve + 200:  # a title of thousands of characters
        title, room = "", size - len(head) - 4
    blocks: dict[int, str] = {}
    for number in document.nearest:
        block = answer_parts[number].full(fence)
        if len(block) + 2 > room - reserve and not blocks:
            block = answer_parts[number].within(fence, room - reserve - 2)
        if len(block) + 2 > room - reserve:
            break
        blocks[number] = block
        room -= len(block) + 2
    lines = [head, title, *(blocks[number] for number in sorted(blocks))]
    if len(blocks) < len(answer_parts):
        lines.append(_left(document, set(blocks)))
    return "\n\n".join(line for line in lines if line)


def _left(document: AgentDocument, taken: set[int]) -> str:
    left = [number for number in range(len(document.parts)) if number not in taken]
    first = min(taken, default=0)
    before = [number for number in left if number < first]
    after = [number for number in left if number > first] if taken else left
    note = f"{len(left):,} of {len(document.parts):,} parts were left out; raise max_chars, or read"
    ways = []
    if before:
        ways.append(f"the part before: {document.parts[before[-1]].place.ref}")
    if after:
        ways.append(f"the part after: {document.parts[after[0]].place.ref}")
    return f"{note} {', '.join(ways)}"


def outward(centre: int, count: int) -> list[int]:
    """All numbers below `count`, nearest to `centre` first, later before earlier."""
    return sorted(range(count), key=lambda number: (abs(number - centre), number < centre))


def first_row(
    tables: OpenTables, short: str, where: str, values: Sequence[Any]
) -> dict[str, Any] | None:
    """The first row that matches, from the fullest table of that name that has one."""
    for view in tables.ranked(short):
        if rows := tables.rows(f"FROM {view.full} WHERE {where}", values).to_pylist():
            return dict(rows[0])
    return None
