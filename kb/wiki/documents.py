"""What `read` shows of a wiki page: its sections with their tables."""

from collections.abc import Iterator
from typing import Any

from kb.core.errors import UsageError
from kb.mcp.documents import (
    AgentDocument,
    DocumentBlock,
    DocumentPart,
    DocumentScreenshot,
    SourceLocation,
    TreeLine,
    anchor,
    first_row,
    outward,
)
from kb.mcp.search_tool import revision
from kb.reader.recipe_tree import RecipeGraph
from kb.reader.tables import OpenTables
from kb.reader.wiki_page import Box, box
from kb.search.passage import plain
from kb.wiki.passages import PageSection, grid, link, sections


def document(opened: OpenTables, place: SourceLocation) -> AgentDocument:
    """The page of a place. Raises UsageError if the page or section is unknown."""
    row = _page(opened, place.key)
    key = row["page_id"]
    elements = _rows(opened, key, "elements", "reading_order")
    cells = _rows(opened, key, "cells", "table_id, row_index, column_index")
    images = _rows(opened, key, "images", "ALL")
    alts = {image["element_id"]: plain(image["alt_text"]).strip() for image in images}
    every = sections(elements, grid(cells), alts)
    shown = [section for section in every if section.anchor or _lines(section)]
    blocks = _blocks(elements, cells, alts)
    parts = [_part(row, section, blocks) for section in shown]
    wanted = anchor(place.at)
    centre = next((n for n, part in enumerate(parts) if anchor(part.place.at) == wanted), None)
    if centre is None and place.at:
        raise UsageError(
            f"the page {key} has no section {wanted[:200]!r}",
            hint=f"read wiki:{key}; the section may belong to another revision",
        )
    url = link(row["url"], row["revision_id"], "")
    facts = (
        f"wiki page · {row['revision_timestamp'].date()} · {revision(url)} ·"
        f" licence {row.get('license') or 'none given'} · {url}"
    )
    chosen = set(shown[centre].elements) if centre is not None else set()
    boxes = [
        box(element)
        for element in elements
        if element["element_id"] in chosen and element["x"] is not None
    ]
    return AgentDocument(
        facts,
        plain(row["title"]),
        parts,
        outward(centre or 0, len(parts)),
        _screenshot(opened, key, boxes),
        list(_made_of(opened, key)),
    )


def _page(opened: OpenTables, key: str) -> dict[str, Any]:
    """The row of a page, by its id, address or title. Raises UsageError without one."""
    if key.isdecimal() and len(key) < 19:
        row = first_row(opened, "wiki_pages", "page_id = ?", [int(key)])
    else:
        row = first_row(opened, "wiki_pages", "url = ? OR title = ?", [key] * 2)
    if row is None:
        raise UsageError(f"unknown page {key[:200]!r}", hint="`search` returns refs")
    return row


def _rows(opened: OpenTables, key: int, short: str, order: str) -> list[dict[str, Any]]:
    """The rows of a page in the first table of that name."""
    for view in opened.ranked(f"wiki_{short}"):
        sql = f"FROM {view.full} WHERE page_id = ? ORDER BY {order}"
        return opened.rows(sql, [key]).to_pylist()
    return []


def _lines(section: PageSection) -> list[str]:
    return [
        *section.lines,
        *("\n".join(table) for table in section.tables),
        *(f"(image: {alt})" for alt in section.alts),
    ]


def _part(
    page: dict[str, Any], section: PageSection, blocks: dict[int, DocumentBlock]
) -> DocumentPart:
    """A section with the address that opens it."""
    url = link(page["url"], page["revision_id"], section.anchor)
    place = SourceLocation("wiki", str(page["page_id"]), url.partition("#")[2])
    label = "section" if section.anchor else "top of the page"
    text = "\n\n".join([*filter(None, [section.path]), *_lines(section)])
    return DocumentPart(place, label, url, text, [blocks[element] for element in section.elements])


def _made_of(opened: OpenTables, key: int) -> Iterator[TreeLine]:
    """The tree of the first thing that a recipe makes and whose page this is."""
    product = first_row(opened, "wiki_recipe_edges", "product_page_id = ?", [key])
    if product is not None:
        waiting = [(0, RecipeGraph(opened).tree(product["product"], 1))]
        while waiting and (node := waiting.pop()):
            level, thing = node
            words = f"{thing['quantity']:,} × {plain(thing['item'])}"
            if thing["station"]:
                words += f" ({thing['station']})"
            elif thing.get("cycle"):
                words += " (as above)"
            page = thing["page_id"]
            yield TreeLine(level, words, f"wiki:{page}" if page is not None and level else "")
            waiting += [(level + 1, below) for below in reversed(thing["needs"])]


def _blocks(
    elements: list[dict[str, Any]], cells: list[dict[str, Any]], alts: dict[int, str]
) -> dict[int, DocumentBlock]:
    """Each element as a page shows it, by its id."""
    grids: dict[int, dict[int, list[tuple[str, bool, int, int]]]] = {}
    for cell in cells:
        row = grids.setdefault(cell["table_id"], {}).setdefault(cell["row_index"], [])
        words = " ".join(plain(cell["text"]).split())
        row.append((words, cell["is_header"], cell["column_span"], cell["row_span"]))
    blocks = {}
    for element in elements:
        key = element["element_id"]
        text = plain(element["text"]).strip() or alts.get(key, "")
        shown = box(element) if element["x"] is not None else None
        table = [*grids.get(key, {}).values()] if element["kind"] == "table" else []
        blocks[key] = DocumentBlock(key, text, element["heading_level"], table, shown)
    return blocks


def _screenshot(opened: OpenTables, key: int, boxes: list[Box]) -> DocumentScreenshot | None:
    """The screenshot of a page, from the first table that names one."""
    sql = "SELECT screenshot_path, page_width, page_height FROM {} WHERE page_id = ?"
    for view in opened.ranked("wiki_pages"):
        for row in opened.rows(sql.format(view.full), [key]).to_pylist():
            if all(row.values()):
                path, width, height = row.values()
                return DocumentScreenshot(view.home, path, width, height, boxes)
    return None
