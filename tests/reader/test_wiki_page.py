"""Wiki pages with their boxes, facts and recipes."""

from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.core.errors import UsageError
from kb.reader.screenshots import COLOURS


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


def test_boxes_are_returned_and_drawn_where_they_are(release: Path) -> None:
    page = kb.load(release).page("Saltstone")
    pattern = literal(release / "wiki" / "elements-*.parquet")
    rows = direct(
        f"SELECT element_id, x, y, width, height FROM {pattern} WHERE kind = 'cell' AND visible"
        f" AND page_id = {page.page_id} ORDER BY reading_order"
    )
    boxes = page.boxes("cell")
    assert [(box.element_id, box.x, box.y, box.width, box.height) for box in boxes] == rows
    plain, drawn = page.screenshot().convert("RGB"), boxes.draw()
    colour = tuple(bytes.fromhex(COLOURS["cell"][1:]))
    for _, x, y, width, height in rows:
        assert drawn.getpixel((round(x + width / 2), round(y))) == colour
        middle = (round(x + width / 2), round(y + height / 2))
        assert drawn.getpixel(middle) == plain.getpixel(middle)
    assert drawn.getpixel((1, 1)) == plain.getpixel((1, 1))
    assert len(page.boxes()) > len(boxes)
    assert all(box.kind == "table" for box in page.boxes("table"))
    with pytest.raises(UsageError, match="'tabel'"):
        page.boxes("tabel")


def test_facts_and_recipes_of_a_page(release: Path) -> None:
    data = kb.load(release)
    facts = [(row["field"], row["value"], row["unit"]) for row in data.page("Saltstone").facts]
    assert facts == [("Hardness", "3", None), ("Melts", "in rain", None)]
    rows = list(data.page("Net loom").recipes)
    shown = [(row["role"], row["slot"], row["item"], row["quantity"]) for row in rows]
    assert shown[:2] == [("input", 0, "Cord 0", 1), ("input", 0, "Cord 1", 1)]
    assert shown[-1] == ("output", 4, "Net", 2)
    assert list(data.page("Saltstone").recipes) == []
