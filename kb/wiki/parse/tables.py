"""Makes the tables of captured pages from their extractions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from itertools import accumulate, chain, repeat
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa

from kb.schema.nested_elements import is_outermost
from kb.schema.tables import Column, table
from kb.store.layout import BELOW, Layout
from kb.store.rawlog.sidefiles import captured_path
from kb.wiki import media_urls
from kb.wiki.parse import extraction, facts

Row = dict[str, Any]
Files = Mapping[str, Row]

PARTS = ("wiki/elements", "wiki/cells", "wiki/images", "wiki/facts", "wiki/recipes")
AT_ONCE = 4_096  # elements that become columns together
LEAST_BYTES = (
    32 << 10
)  # what a small extraction counts at least: at most 256 pages to a bucket of 8 MB


def size(root: Path) -> int:
    """Bytes of all extractions, as raw data that a bucket must hold."""
    return sum(
        max(path.stat().st_size, LEAST_BYTES)
        for path in Layout(root).captures.glob("*/*/extraction.json.zst")
    )


def read_pages(
    root: Path, rows: dict[str, Any], follows: bool, *, rules: facts.MarkupRules
) -> dict[str, Any]:
    """Pages with sizes, `text` and `word_count`; with `whole` also the tables of PARTS.

    `rows` is what kb.wiki.parse.join gave; a page that was not captured gets nulls, and one for
    which another page was stored is one that could not be shown (`render`: "challenge"). `rules`
    tell names and units of facts and recipes. Of the extractions a few at a time are held. Raises
    DamagedData.
    """
    pages = rows["wiki/pages"]
    stored: Files = (
        {row["key"]: row for row in rows["files"].to_pylist() if row["path"] is not None}
        if follows
        else {}
    )
    parts = _Parts(stored, rules)
    measured = _measured()
    columns: dict[str, list[Any]] = {
        name: [] for name in ("screenshot_path", *measured, "word_count", "text")
    }
    render = pages["render"].to_pylist()
    for row, page in enumerate(
        pages.select(["page_id", "folder", "title", "revision_id"]).to_pylist()
    ):
        folder = page["folder"]
        values_of_page: Row = {}
        seen = None if folder is None else extraction.read(root, captured_path(root, folder))
        if seen is not None and extraction.is_foreign(seen.page, page["page_id"]):
            render[row] = "challenge"
        elif seen is not None:
            text = page_text(seen.elements)
            values_of_page = {name: take(seen.page) for name, take in measured.items()}
            values_of_page |= {
                "screenshot_path": f"{folder}/screenshot.png",
                "word_count": len(text.split()),
                "text": text,
            }
            if follows:
                parts.add(page, seen)
        for name, values in columns.items():
            values.append(values_of_page.get(name))
    place = pages.schema.get_field_index("render")
    pages = pages.set_column(place, pages.schema.field(place), pa.array(render, pa.string()))
    types = {column.name: column.parsed.arrow() for column in table("wiki/pages").columns}
    for name, values in columns.items():
        pages = pages.append_column(name, pa.array(values, types.get(name, pa.string())))
    return {"wiki/pages": pages, **(parts.tables() if follows else {})}


class _Parts:
    """The tables that follow the pages, a column at once of some pages."""

    def __init__(self, files: Files, rules: facts.MarkupRules) -> None:
        self._files, self._rules = files, rules
        self._done: dict[str, list[pa.Table]] = {
            name: [table(name).arrow().empty_table()] for name in PARTS
        }
        self._waiting: list[tuple[Row, extraction.Extraction]] = []
        self._size = 0

    def add(self, page: Row, seen: extraction.Extraction) -> None:
        """One page with what was seen of it."""
        self._waiting.append((page, seen))
        self._size += len(seen.elements)
        if self._size >= AT_ONCE:
            self._flush()

    def tables(self) -> dict[str, pa.Table]:
        """All of them, by name."""
        self._flush()
        return {name: pa.concat_tables(parts) for name, parts in self._done.items()}

    def _flush(self) -> None:
        waiting, rules = self._waiting, self._rules
        ids = [(page["page_id"], seen) for page, seen in waiting]
        made: dict[str, Any] = {
            "wiki/elements": elements([(key, seen.elements) for key, seen in ids], rules),
            "wiki/cells": cells([(key, seen.cells) for key, seen in ids]),
        }
        rows: dict[str, Iterable[list[Row]]] = {
            "wiki/images": (image_rows(key, seen, self._files) for key, seen in ids),
            "wiki/facts": (facts.facts(page, seen.facts, rules) for page, seen in waiting),
            "wiki/recipes": (facts.recipes(page, seen.recipes, rules) for page, seen in waiting),
        }
        made |= {name: _columns(name, chain.from_iterable(each)) for name, each in rows.items()}
        for name, part in made.items():
            self._done[name].append(part)
        self._waiting, self._size = [], 0


def outermost_texts(elements: list[Any]) -> Iterator[Any]:
    """Visible texts and cells that no other one of the same table contains: every word once."""
    parents = {element.id: element.parent for element in elements}
    kinds = {element.id: element.kind for element in elements}
    for element in elements:
        wanted = element.visible and element.kind in ("text", "cell")
        if wanted and is_outermost(element.id, parents, kinds):
            yield element


def page_text(elements: list[Any]) -> str:
    """The visible text of a page in reading order, a block a line."""
    return "\n".join(element.text for element in outermost_texts(elements) if element.text)


def elements(pages: list[tuple[int, list[Any]]], rules: facts.MarkupRules) -> pa.Table:
    """Rows of wiki/elements of some pages, in reading order."""

    def text(element: Any) -> str | None:
        if element.kind == "sprite":
            return facts.name_inside(element.text, rules.item)
        content: str | None = element.text if element.kind in ("text", "cell") else None
        return content

    entries = list(chain.from_iterable(each for _, each in pages))
    order = chain.from_iterable(range(len(each)) for _, each in pages)
    return _made(
        "wiki/elements",
        pages,
        text=list(map(text, entries)),
        lines=_lines(entries),
        reading_order=list(order),
    )


def _lines(elements: list[Any]) -> pa.Array[Any]:
    """The boxes of each text's lines; null for what has none: pictures, hidden text, and pages
    that were captured before lines were read.
    """
    each = [element.lines for element in elements]
    ends = list(accumulate((len(lines or ()) for lines in each), initial=0))
    # Arrow takes the end of a list as null where the list is.
    offsets = [None if lines is None else end for lines, end in zip(each, ends, strict=False)]
    flat = [box for lines in each for box in lines or ()]
    sides = [pa.array([float(box[side]) for box in flat], pa.float64()) for side in range(4)]
    boxes = pa.StructArray.from_arrays(sides, names=list(extraction.SIDES))
    return pa.ListArray.from_arrays(pa.array([*offsets, ends[-1]], pa.int32()), boxes)


def cells(pages: list[tuple[int, list[Any]]]) -> pa.Table:
    """Rows of wiki/cells of some pages, grid places from 0."""
    entries = list(chain.from_iterable(each for _, each in pages))
    row, column = (list(map(attrgetter(name), entries)) for name in ("row", "column"))
    return _made("wiki/cells", pages, row_index=row, column_index=column)


@cache
def _measured() -> dict[str, Callable[[Row], Any]]:
    """How columns of wiki/pages are read from what the extraction says of the page."""
    makers = {}
    for column in table("wiki/pages").columns:
        if column.source.kind == "extraction":
            makers[column.name] = _number(column.source.path.removeprefix("page."), column)
    return makers


def _number(field: str, column: Column) -> Callable[[Row], int | float]:
    # Sizes may come as 1280.0, which Arrow takes for no whole number.
    kind = float if column.type.startswith("float") else int
    return lambda page: kind(page[field])


def _made(name: str, pages: list[tuple[int, list[Any]]], **more: Any) -> pa.Table:
    """A table of some pages' entries; `more` are the columns that rules make."""
    entries = list(chain.from_iterable(each for _, each in pages))
    boxes = [entry.box for entry in entries]
    keys = chain.from_iterable(repeat(key, len(each)) for key, each in pages)
    made = {"page_id": list(keys), **more}
    arrays: list[pa.Array[Any]] = []
    for column in table(name).columns:
        values, kind = made.get(column.name), column.parsed.arrow()
        if values is None and (field := extraction.field(column)) == "box":
            values = list(map(itemgetter(extraction.SIDES.index(column.name)), boxes))
        elif values is None:
            values = list(map(attrgetter(field), entries))
        arrays.append(values if isinstance(values, pa.Array) else pa.array(values, kind))
    return pa.table(arrays, schema=table(name).arrow())


def _columns(name: str, rows: Iterable[Row]) -> pa.Table:
    return pa.Table.from_pylist(list(rows), table(name).arrow())


def image_rows(page_id: int, seen: extraction.Extraction, files: Files) -> list[Row]:
    """Rows of wiki/images: the original file of every image, one row a frame of what moves."""
    rows: list[Row] = []
    sprites = seen.sprites
    for element in seen.elements:
        if element.kind not in ("image", "sprite", "animation"):
            continue
        base = {
            "page_id": page_id,
            "element_id": element.id,
            "alt_text": element.alt or None,
            "caption": element.caption or None,
        }
        if element.frames:
            for index, frame in enumerate(element.frames):
                if row := _file_row(frame.get("src"), files):
                    duration = frame.get("duration")
                    alt = frame.get("alt") or base["alt_text"]
                    moment = {
                        "alt_text": alt,
                        "frame_index": index,
                        "frame_duration_ms": None if duration is None else round(duration),
                    }
                    rows.append({**base, **row, **moment})
            continue
        row = _file_row(element.src, files)
        if row is None:
            continue
        pixels = sprites.get(str(element.id))
        if pixels:
            # An icon of a sheet: the cut-out pixels, not the sheet that it shares with the others.
            width, height = map(round, element.crop) if element.crop else (None, None)
            row |= {
                "path": str(BELOW.images / f"{pixels}.png"),
                "sha256": pixels,
                "media_type": "image/png",
                "width": width,
                "height": height,
            }
        durations = () if pixels else _durations(element.src, files)
        if durations:
            rows += [
                {**base, **row, "frame_index": index, "frame_duration_ms": duration}
                for index, duration in enumerate(durations)
            ]
        else:
            rows.append({**base, **row, "frame_index": None, "frame_duration_ms": None})
    return rows


def _file_row(src: str | None, files: Files) -> Row | None:
    if not src or not src.startswith(("http:", "https:")):
        return None
    key = media_urls.original(src)
    stored = files.get(key, {})
    names = ("path", "sha256", "media_type", "width", "height", "license")
    return {"src": stored.get("url") or key, **{name: stored.get(name) for name in names}}


def _durations(src: str | None, files: Files) -> list[int | None]:
    return files.get(media_urls.original(src or ""), {}).get("frames") or []
