"""Writes a wiki page as Markdown for language models, out of elements, cells, facts and recipes
in reading order.

Headings have their level, lists their depth. A table is a Markdown table with the words of a cell
in every place that it spans; its nested tables and recipes follow it. An infobox
without a table is made one by its facts. A recipe is a grid of its slots. Links to pages of the
wiki name their titles, `[a pit](Fire pit)`, and icons stand as their names where the words do not
say them. Tables of contents, boxes of links and what a page neither shows nor offers to show are
left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import pyarrow as pa

from kb.core.cached_property import cached_property

Row = dict[str, Any]
Grid = list[list[str]]

GAP = "\n\n"  # between two blocks
_LEFT_OUT = ("toc", "navbox")
_LISTS = ("ul", "ol", "dl")
# What Markdown would take for a mark at the beginning of a line.
_MARK = re.compile(r"^(?=#{1,6} |>|\||[-+*] |```|~~~|=+$|-{3,}$)", re.MULTILINE)
_AMOUNT = re.compile(r"[\d\s.,×x/–-]*")


def page_markdown(title: str, tables: Mapping[str, pa.Table]) -> str:
    """The text of a page, of its rows of the tables: its title, then its blocks."""
    names = ("elements", "cells", "facts", "recipes")
    page = PageText(*(tables[name].to_pylist() for name in names))
    return GAP.join([f"# {' '.join(title.split())}", *page.blocks()])


def is_left_out(element: Row) -> bool:
    """Whether an element is no part of a page's text: boxes of links, and what it never shows."""
    return element["region"] in _LEFT_OUT or not (element["visible"] or element.get("folded"))


class PageText:
    """One page: its rows of the tables."""

    def __init__(
        self, elements: list[Row], cells: list[Row], facts: list[Row], recipes: list[Row]
    ) -> None:
        self._elements = {element["element_id"]: element for element in elements}
        self._children: dict[int | None, list[Row]] = {}
        for element in elements:
            parent = element["parent_id"] if element["parent_id"] in self._elements else None
            self._children.setdefault(parent, []).append(element)
        self._cells: dict[int, list[Row]] = {}
        for cell in cells:
            self._cells.setdefault(cell["table_id"], []).append(cell)
        self._fields = {fact["element_id"]: fact["field"] for fact in reversed(facts)}
        self._recipes = {
            number: list(slots)
            for number, slots in groupby(recipes, lambda slot: slot["recipe_index"])
        }
        self._written: set[int] = set()  # recipes

    @cached_property
    def _slots(self) -> dict[int, int]:
        """The recipe of each element that stands for a slot."""
        return {
            slot["element_id"]: number
            for number, slots in self._recipes.items()
            for slot in slots
            if slot["element_id"] is not None
        }

    def blocks(self) -> Iterator[str]:
        """The blocks of the page, without its title."""
        tops = self._children.get(None, [])
        heading = next((element for element in tops if element["kind"] == "text"), None)
        if heading is not None and heading["heading_level"] == 1:
            tops = [element for element in tops if element is not heading]
        yield from self._blocks(tops)

    def _blocks(self, elements: Iterable[Row]) -> Iterator[str]:
        waiting: list[Row] = []  # of an infobox without a table, or icons in a row
        for element in elements:
            if is_left_out(element):
                continue
            kind = _gathered(element)
            if waiting and kind != _gathered(waiting[0]):
                yield from self._together(waiting)
                waiting = []
            if kind:
                waiting.append(element)
            elif element["region"] == "recipe" and element["kind"] != "table":
                yield from self._recipe_at(element)
            elif element["kind"] == "table":
                yield from self._table(element)
            elif element["kind"] == "text":
                yield from self._text(element)
                yield from self._inside(element)
            else:
                yield from self._blocks(self._children.get(element["element_id"], ()))
        if waiting:
            yield from self._together(waiting)

    def _together(self, elements: Sequence[Row]) -> Iterator[str]:
        if _gathered(elements[0]) == "icons":
            names = [element["text"] for element in elements if element["text"]]
            if names:
                yield ", ".join(names)
        else:
            yield from self._infobox(elements)

    def _inside(self, holder: Row) -> Iterator[str]:
        """Tables and recipes within a text or a cell, which its words leave out."""
        for element in self._children.get(holder["element_id"], ()):
            if is_left_out(element):
                continue
            if element["kind"] == "table":
                yield from self._table(element)
            elif element["element_id"] in self._slots:
                yield from self._recipe(self._slots[element["element_id"]])
            else:
                yield from self._inside(element)

    # -- texts -------------------------------------------------------------------------------------

    def _text(self, element: Row) -> Iterator[str]:
        level, text = element["heading_level"], element["text"] or ""
        if not text.strip():
            return
        if level and element["region"] != "infobox":
            yield f"{'#' * level} {' '.join(text.split())}"
        elif element["tag"] in (*_LISTS, "li", "dt", "dd"):
            yield "\n".join(self._list(element, ""))
        elif element["tag"] == "pre":
            fence = "```" if "```" not in text else "~~~~"
            yield f"{fence}\n{text}\n{fence}"
        else:
            words = _escaped(_inline(element))
            quote = "> " if element["tag"] == "blockquote" else ""
            yield "\n".join(f"{quote}{line}" for line in words.split("\n"))

    def _list(self, element: Row, indent: str, number: int = 0) -> Iterator[str]:
        """The lines of a list or of one of its points, with what is nested in it."""
        mark = f"{number}. " if number else "- "
        own, deeper = indent, indent
        if element["tag"] not in _LISTS:
            own, deeper = f"{indent}{mark}", indent + " " * len(mark)
        count, dt = 0, False
        for part in self._split(element):
            if isinstance(part, str):
                for line in part.split("\n"):
                    yield f"{own}{line}"
                    own = deeper
                continue
            if own != deeper:  # a point that begins with a list
                yield own.rstrip()
                own = deeper
            count += 1
            dt = dt or part["tag"] == "dt"
            below = dt and part["tag"] == "dd"
            yield from self._list(
                part, f"{deeper}  " if below else deeper, count if element["tag"] == "ol" else 0
            )

    def _split(self, element: Row) -> Iterator[str | Row]:
        """The text of a list or point: its own words, and the points or lists between them."""
        text, begin = element["text"], 0
        wanted = ("li", "dt", "dd") if element["tag"] in _LISTS else _LISTS
        for child in self._nearest(element, wanted):
            place = re.compile(rf"^{re.escape(child['text'])}$", re.MULTILINE).search(text, begin)
            if place is None:
                continue
            if own := _inline(element, begin, place.start()).strip("\n"):
                yield own
            yield child
            begin = place.end()
        if (own := _inline(element, begin, len(text)).strip("\n")) or not begin:
            yield own

    def _nearest(self, element: Row, tags: Sequence[str]) -> Iterator[Row]:
        for child in self._children.get(element["element_id"], ()):
            if child["kind"] != "text" or is_left_out(child) or not child["text"]:
                continue
            if child["tag"] in tags:
                yield child
            else:
                yield from self._nearest(child, tags)

    # -- tables ------------------------------------------------------------------------------------

    def _table(self, element: Row) -> Iterator[str]:
        children = self._children.get(element["element_id"], ())
        for child in children:
            if child["kind"] == "text" and child["tag"] == "caption" and not is_left_out(child):
                yield from self._text(child)
        grid = self._grid(element["element_id"])
        if any(map(any, grid)):
            yield _markdown(grid)
        yield from self._inside(element)

    def _grid(self, number: int) -> Grid:
        """The rows of a table with the words of a cell in every place that it covers; without rows
        that are hidden.
        """
        cells = self._cells.get(number, [])
        height = max((cell["row_index"] + cell["row_span"] for cell in cells), default=0)
        width = max((cell["column_index"] + cell["column_span"] for cell in cells), default=0)
        grid = [[""] * width for _ in range(height)]
        shown = set[int]()
        for cell in cells:
            element = self._elements.get(cell["element_id"])
            if element is not None and is_left_out(element):
                continue
            words = self._cell(cell, element)
            for row in range(cell["row_index"], cell["row_index"] + cell["row_span"]):
                shown.add(row)
                for column in range(
                    cell["column_index"], cell["column_index"] + cell["column_span"]
                ):
                    grid[row][column] = words
        return [row for number, row in enumerate(grid) if number in shown]

    def _cell(self, cell: Row, element: Row | None) -> str:
        if cell["text"]:
            return _inline(element if element is not None else cell)
        below = self._children.get(cell["element_id"], ())
        icons = (icon for icon in below if icon["kind"] in ("sprite", "animation"))
        return ", ".join(icon["text"] for icon in icons if icon["text"])

    def _infobox(self, elements: Iterable[Row]) -> Iterator[str]:
        """The parts of an infobox that is no table: a row a field with its value, what else stands
        there a row of its own; paragraphs where no field was read.
        """
        rows: Grid = []
        paired = False
        for element in self._unfolded(elements):
            words, field = (
                " ".join(_inline(element).split()),
                self._fields.get(element["element_id"]),
            )
            label = rows[-1][0] if rows and not rows[-1][1] else ""
            if label and field and _name(label) == _name(field.rpartition(" › ")[2]):
                rows[-1][1], paired = words, True
            elif words:
                rows.append([words, ""])
        if not paired:
            yield from (_escaped(words) for words, _ in rows)
            return
        title = rows.pop(0) if not rows[0][1] else ["", ""]
        yield _markdown([title, *rows])

    def _unfolded(self, elements: Iterable[Row]) -> Iterator[Row]:
        """The texts of an infobox; of lists of terms the terms and their values."""
        for element in elements:
            if element["kind"] != "text" or not element["text"]:
                continue
            terms = [*self._nearest(element, ("dt", "dd"))] if element["tag"] == "dl" else []
            yield from terms or [element]

    # -- recipes -----------------------------------------------------------------------------------

    def _recipe_at(self, element: Row) -> Iterator[str]:
        """A recipe where its first slot stands; other words of it as they are."""
        number = self._slots.get(element["element_id"])
        if number is not None:
            yield from self._recipe(number)
        else:
            if element["kind"] == "text" and not _AMOUNT.fullmatch(element["text"] or ""):
                yield from self._text(element)
            yield from self._inside(element)

    def _recipe(self, number: int) -> Iterator[str]:
        """A grid of what goes in, then what comes out behind an arrow."""
        if number in self._written:
            return
        self._written.add(number)
        given: dict[tuple[int, int], list[str]] = {}
        made: dict[tuple[int, int], list[str]] = {}
        for slot in self._recipes[number]:
            places = given if slot["role"] == "input" else made
            place = places.setdefault((slot["row_index"], slot["column_index"]), [])
            amount = f" ×{slot['quantity']}" if (slot["quantity"] or 1) > 1 else ""
            named = f"{slot['item']}{amount}" if slot["item"] else ""
            if named and named not in place:  # several are shown in turn
                place.append(named)
        if any(given.values()):
            height, width = (max(place[axis] for place in given) + 1 for axis in (0, 1))
            rows = [
                [given.get((row, column), []) for column in range(width)] for row in range(height)
            ]
            yield _markdown([[" / ".join(names) for names in row] for row in rows])
        if any(made.values()):
            yield "→ " + ", ".join(" / ".join(names) for names in made.values() if names)


def _gathered(element: Row) -> str:
    """What an element is written together with."""
    if element["region"] == "infobox" and element["kind"] != "table":
        return "infobox"
    return "icons" if element["kind"] == "sprite" and element["region"] != "recipe" else ""


def _inline(element: Row, begin: int = 0, end: int | None = None) -> str:
    """A text from `begin` to `end` with its links, and with names of icons that it does not say."""
    text = element["text"] or ""
    end = len(text) if end is None else end
    if not element.get("marks"):
        return text[begin:end]
    out, at, folded = "", begin, text.casefold()
    for mark in sorted(element["marks"], key=lambda mark: (mark["start"], mark["end"])):
        start, stop, title = mark["start"], mark["end"], mark["title"]
        if not title or start < at or stop > end or (start >= end and start != len(text)):
            continue
        if start == stop:
            if title.casefold() in folded:
                continue
            gap = (
                ""
                if (not text[at:start] and not out) or text[:start].endswith((" ", "\n"))
                else " "
            )
            behind = "" if text[start : start + 1] in ("", " ", ".", ",", ")", "\n") else " "
            out, at = f"{out}{text[at:start]}{gap}{title}{behind}", start
        elif label := text[start:stop].strip():
            shown = re.sub(r"([\[\]])", r"\\\1", label)
            target = f"<{title}>" if re.search(r"[\s()<>]", title) else title
            out, at = f"{out}{text[at:start]}[{shown}]({target})", stop
    return out + text[at:end]


def _escaped(text: str) -> str:
    return _MARK.sub(r"\\", text)


def _name(text: str) -> str:
    return text.strip().rstrip(":：").rstrip().casefold()


def _markdown(grid: Grid) -> str:
    """A table whose first row is the head."""
    lines = [
        "| " + " | ".join(" ".join(words.split()).replace("|", "\\|") for words in row) + " |"
        for row in grid
    ]
    return "\n".join([lines[0], "|" + " --- |" * len(grid[0]), *lines[1:]])
