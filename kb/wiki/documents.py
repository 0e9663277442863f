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
from kb.wiki.passages import grid, link, sections


def document(opened: OpenTables, place: SourceLocation) -> AgentDocument:
    """The page of a place. Raises UsageError if the page or section is unknown."""
    by_key = place.key.isdecimal() and len(place.key) < 19
    if by_key:
        row = first_row(opened, "wiki_pages", "page_id = ?", [int(place.key)])
    else:
        row = first_row(opened, "wiki_pages", "url = ? OR title = ?", [place.key] * 2)
    if row is None:
        raise UsageError(f"unknown page {place.key[:200]!r}", hint="`search` returns refs")
    key = row["page_id"]

    def rows(short: str, order: str) -> list[dict[str, Any]]:
        for view in opened.ranked(f"wiki_{short}"):
            sql = f"FROM {view.full} WHERE page_id = ? ORDER BY {order}"
            return opened.rows(sql, [key]).to_pylist()
        return []

    cells = rows("cells", "table_id, row_index, column_index")
    tables = grid(cells)
    alts = {
        image["element_id"]: plain(image["alt_text"]).strip() for image in rows("images", "ALL")
    }
    parts: list[DocumentPart] = []
    made_from: list[list[int]] = []  # the elements of each part
    centre = -1
    elements = rows("elements", "reading_order")
    blocks = _blocks(elements, cells, alts)
    for section in sections(elements, tables, alts):
        lines = [
            *section.lines,
            *("\n".join(table) for table in section.tables),
            *(f"(image: {alt})" for alt in section.alts),
        ]
        if not lines and not section.anchor:
            continue
        url = link(row["url"], row["revision_id"], section.anchor)
        at = url.partition("#")[2]
        if centre < 0 and anchor(at) == anchor(place.at):
            centre = len(parts)
        text = "\n\n".join([*([section.path] if section.path else []), *lines])
        label = "section" if section.anchor else "top of the page"
        of_part = [blocks[element] for element in section.elements]
        parts.append(DocumentPart(SourceLocation("wiki", str(key), at), label, url, text, of_part))
        made_from.append(section.elements)
    if centre < 0 and place.at:
        raise UsageError(
            f"the page {key} has no section {anchor(place.at)[:200]!r}",
            hint=f"read wiki:{key}; the section may belong to another revision",
        )
    url = link(row["url"], row["revision_id"], "")
    facts = (
        f"wiki page · {row['revision_timestamp'].date()} · {revision(url)} ·"
        f" licence {row.get('license') or 'none given'} · {url}"
    )
    chosen = set(made_from[centre]) if centre >= 0 else set()
    boxes = [
        box(element)
        for element in elements
        if element["element_id"] in chosen and element["x"] is not None
    ]
    return AgentDocument(
        facts,
        plain(row["title"]),
        parts,
        outward(max(centre, 0), len(parts)),
        _screenshot(opened, key, boxes),
        list(_made_of(opened, key)),
    )


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
