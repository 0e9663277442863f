"""Wiki pages as passages: sections with their headings, tables as rows, alt texts of images.

A list's text holds that of its points, a figure's that of its caption: what is inside of a text
that was taken is not taken again. Tables of contents and boxes of links are left out, and what a
page neither shows nor offers to show.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

from kb.core.config.profile import Profile
from kb.search.passage import MOST_WORDS, Passage, day, pieces, plain, rows
from kb.store.tables.merge import RowsByKey
from kb.wiki.markdown import is_left_out

_PAGE = ["page_id", "title", "url", "revision_id", "revision_timestamp", "license"]
_ELEMENT = ["page_id", "element_id", "parent_id", "kind", "tag", "region", "heading_level"]
_CELL = ["page_id", "table_id", "row_index", "column_index", "text"]
_ANCHOR = "!$'()*,-./:;=?@_~"  # what a fragment may hold as it is


@dataclass
class PageSection:
    """What stands under one heading; `elements` are the ids of what it was made from."""

    anchor: str = ""
    path: str = ""
    elements: list[int] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    alts: list[str] = field(default_factory=list)
    tables: list[list[str]] = field(default_factory=list)


def passages(_: Profile, root: Path) -> Iterator[Passage]:
    """The passages of all kept pages, by page. Raises DamagedData."""
    shown = [*_ELEMENT, "text", "visible", "folded"]
    elements = RowsByKey(rows(root, "wiki/elements", shown), "page_id")
    cells = RowsByKey(rows(root, "wiki/cells", _CELL), "page_id")
    images = RowsByKey(rows(root, "wiki/images", ["page_id", "element_id", "alt_text"]), "page_id")
    for page in rows(root, "wiki/pages", _PAGE):
        key = page["page_id"]
        tables = grid(cells.rows_of(key))
        alts = {
            image["element_id"]: plain(image["alt_text"]).strip() for image in images.rows_of(key)
        }
        for section in sections(elements.rows_of(key), tables, alts):
            yield from _of(page, section)


def grid(cells: Iterable[dict[str, Any]]) -> dict[int, list[str]]:
    """The rows of each table of a page, the words of a row's cells between bars."""
    grids: dict[int, list[str]] = {}
    for (table, _), row in groupby(cells, key=lambda cell: (cell["table_id"], cell["row_index"])):
        words = [" ".join(plain(cell["text"]).split()) for cell in row]
        line = " | ".join(word for word in words if word)
        if line:
            grids.setdefault(table, []).append(line)
    return grids


def sections(
    elements: Iterable[dict[str, Any]], tables: dict[int, list[str]], alts: dict[int, str]
) -> Iterator[PageSection]:
    """The sections of a page, out of its elements in reading order."""
    headings: list[tuple[int, str]] = []
    anchors: Counter[str] = Counter()
    taken: set[int] = set()
    section = PageSection()
    for element in elements:
        key, text = element["element_id"], plain(element["text"]).strip()
        inside = element["parent_id"] in taken
        left_out = is_left_out(element)
        if inside or left_out:
            taken.add(key)
        if left_out:
            continue
        # The parts of an infobox have headings, which begin no section of the page.
        level = None if element["region"] == "infobox" else element["heading_level"]
        if alts.get(key):
            section.elements.append(key)
            if alts[key] not in section.alts:
                section.alts.append(alts[key])
        elif element["kind"] == "table":
            taken.add(key)
            if tables.get(key):
                section.elements.append(key)
                section.tables.append(tables[key])
        elif element["kind"] == "text" and element["tag"] == "caption" and section.tables and text:
            section.tables[-1].insert(0, text)
        elif element["kind"] != "text" or inside or not text:
            continue
        elif level is None:
            taken.add(key)
            section.elements.append(key)
            section.lines.append(text)
        else:
            taken.add(key)
            yield section
            headings = [*((n, name) for n, name in headings if n < level), (level, text)]
            section = _begun(headings, anchors)
            section.elements.append(key)
    yield section


def _begun(headings: list[tuple[int, str]], anchors: Counter[str]) -> PageSection:
    """An empty section under these headings; the page's own title is none of them."""
    names = [" ".join(name.split()) for level, name in headings if level > 1]
    if not names:
        return PageSection()
    anchor = names[-1].replace(" ", "_")
    anchors[anchor.lower()] += 1
    number = anchors[anchor.lower()]
    return PageSection(anchor if number == 1 else f"{anchor}_{number}", " › ".join(names))


def _of(page: dict[str, Any], section: PageSection) -> Iterator[Passage]:
    about = {
        "key": str(page["page_id"]),
        "thing": str(page["page_id"]),
        "title": plain(page["title"]),
        "path": section.path,
        "url": link(page["url"], page["revision_id"], section.anchor),
        "date": day(page["revision_timestamp"]),
        "licence": page["license"],
    }
    alt = "\n".join(section.alts)
    for text in list(pieces(section.lines)) or ([""] if alt else []):
        yield Passage("section", text=text, alt=alt, **about)
        alt = ""  # with the first piece alone
    for table in section.tables:
        for text in pieces(table, MOST_WORDS):
            yield Passage("table", text=text, **about)


def link(url: str, revision: int, anchor: str) -> str:
    """The address of a section as it was read."""
    there = f"{url}{'&' if '?' in url else '?'}oldid={revision}"
    return f"{there}#{quote(anchor, safe=_ANCHOR)}" if anchor else there
