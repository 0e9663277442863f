"""Captured pages → the contract's tables, from the extractions beside the raw log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import zstandard

from kb.schema.tables import Column, table
from kb.store import sidefiles
from kb.store.inside import inside
from kb.store.layout import BELOW, Layout
from kb.wiki import addresses, shown

Row = dict[str, Any]
Files = Mapping[str, Row]

PARTS = ("wiki/elements", "wiki/cells", "wiki/images", "wiki/facts", "wiki/recipes")
_SIDES = ("x", "y", "width", "height")
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
    root: Path, rows: dict[str, Any], whole: bool, *, rules: shown.Rules
) -> dict[str, Any]:
    """Pages with sizes, `text` and `word_count`; with `whole` also the tables of PARTS.

    `rows` is what kb.wiki.assemble gave; a page that was not captured gets nulls. `rules` tell
    names and units of facts and recipes. Of the extractions one at a time is held. Raises
    DamagedData.
    """
    pages = rows["wiki/pages"]
    held: Files = (
        {row["key"]: row for row in rows["files"].to_pylist() if row["path"] is not None}
        if whole
        else {}
    )
    parts: dict[str, list[pa.Table]] = {name: [table(name).arrow().empty_table()] for name in PARTS}
    measured = _measured()
    columns: dict[str, list[Any]] = {
        name: [] for name in ("screenshot_path", *measured, "word_count", "text")
    }
    for page in pages.select(["page_id", "folder", "title", "revision_id"]).to_pylist():
        page_id, folder = page["page_id"], page["folder"]
        found: Row = {}
        if folder is not None:
            extraction = read_extraction(root, inside(root, folder))
            text = page_text(extraction["elements"])
            found = {name: take(extraction["page"]) for name, take in measured.items()}
            found |= {
                "screenshot_path": f"{folder}/screenshot.png",
                "word_count": len(text.split()),
                "text": text,
            }
            if whole:
                parts["wiki/elements"].append(elements(page_id, extraction["elements"], rules))
                parts["wiki/cells"].append(cells(page_id, extraction["cells"]))
                said = {
                    "wiki/images": image_rows(page_id, extraction, held),
                    # Extractions of earlier versions have neither.
                    "wiki/facts": shown.facts(page, extraction.get("facts", ()), rules),
                    "wiki/recipes": shown.recipes(page, extraction.get("recipes", ()), rules),
                }
                for name, made in said.items():
                    parts[name].append(_columns(name, made))
        for name, values in columns.items():
            values.append(found.get(name))
    types = {column.name: column.parsed.arrow() for column in table("wiki/pages").columns}
    for name, values in columns.items():
        pages = pages.append_column(name, pa.array(values, types.get(name, pa.string())))
    return {
        "wiki/pages": pages,
        **({name: pa.concat_tables(found) for name, found in parts.items()} if whole else {}),
    }


def read_extraction(root: Path, folder: Path) -> Row:
    """What the page script saw. Raises DamagedData, and notes the page for the next crawl."""
    path = folder / "extraction.json.zst"
    try:
        extraction: Row = msgspec.json.decode(
            zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes())
        )
    except (OSError, zstandard.ZstdError, msgspec.DecodeError) as error:
        told = sidefiles.lost(root, "wiki", [path])
        told.args = (f"{path} can't be read: {error}",)
        raise told from None
    return extraction


def tops(elements: list[Row]) -> Iterator[Row]:
    """Visible texts and cells that no other one of the same table holds: every word once."""
    by_id = {element["id"]: element for element in elements}
    for element in elements:
        if element["kind"] not in ("text", "cell") or not element["visible"]:
            continue
        parent = by_id.get(element["parent"])
        # A text never takes in what stands in a table, so a table between the two parts them.
        while parent is not None and parent["kind"] not in ("text", "cell", "table"):
            parent = by_id.get(parent["parent"])
        if parent is None or parent["kind"] == "table":
            yield element


def page_text(elements: list[Row]) -> str:
    """The visible text of a page in reading order, a block a line."""
    return "\n".join(element["text"] for element in tops(elements) if element["text"])


def elements(page_id: int, found: list[Row], rules: shown.Rules) -> pa.Table:
    """Rows of wiki/elements, in reading order."""

    def text(element: Row) -> str | None:
        if element["kind"] == "sprite":
            return shown.inside(element["text"], rules.item)
        said: str | None = element["text"] if element["kind"] in ("text", "cell") else None
        return said

    makers = _declared("wiki/elements", "elements") | {"text": text}
    del makers["lines"]
    order, boxes = range(len(found)), _lines(found)
    return _made("wiki/elements", page_id, found, makers, reading_order=order, lines=boxes)


def _lines(found: list[Row]) -> pa.Array[Any]:
    """The boxes of each text's lines; null for what has none: pictures, hidden text, and pages
    that an earlier version captured.
    """
    each = [element.get("lines") for element in found]
    ends = list(accumulate((len(lines or ()) for lines in each), initial=0))
    # Arrow takes the end of a list as null where the list is.
    offsets = [None if lines is None else end for lines, end in zip(each, ends, strict=False)]
    flat = [box for lines in each for box in lines or ()]
    sides = [pa.array([float(box[side]) for box in flat], pa.float64()) for side in range(4)]
    boxes = pa.StructArray.from_arrays(sides, names=list(_SIDES))
    return pa.ListArray.from_arrays(pa.array([*offsets, ends[-1]], pa.int32()), boxes)


def cells(page_id: int, found: list[Row]) -> pa.Table:
    """Rows of wiki/cells, grid places from 0."""
    makers = _declared("wiki/cells", "cells") | {
        "row_index": itemgetter("row"),
        "column_index": itemgetter("column"),
    }
    return _made("wiki/cells", page_id, found, makers)


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


@cache
def _declared(name: str, entries: str) -> dict[str, Callable[[Row], Any]]:
    """How a table's columns are read from an entry of the extraction's list, by their `from`."""
    makers: dict[str, Callable[[Row], Any]] = {}
    for column in table(name).columns:
        if column.source.kind != "extraction":
            continue
        field = column.source.path.removeprefix(f"{entries}[].")
        take: Callable[[Row], Any] = itemgetter(field)
        if field == "box":
            take = partial(_side, _SIDES.index(column.name))
        makers[column.name] = take
    return makers


def _side(place: int, entry: Row) -> float:
    edge: float = entry["box"][place]
    return edge


def _made(
    name: str,
    page_id: int,
    found: list[Row],
    makers: Mapping[str, Callable[[Row], Any]],
    **more: Any,
) -> pa.Table:

    columns = (
        {column: list(map(make, found)) for column, make in makers.items()}
        | more
        | {"page_id": [page_id] * len(found)}
    )
    schema = table(name).arrow()
    made = (columns[field.name] for field in schema)
    arrays = (
        one if isinstance(one, pa.Array) else pa.array(one, field.type)
        for one, field in zip(made, schema, strict=True)
    )
    return pa.table(list(arrays), schema=schema)


def _columns(name: str, rows: list[Row]) -> pa.Table:

    return pa.Table.from_pylist(rows, table(name).arrow())


def image_rows(page_id: int, extraction: Row, files: Files) -> list[Row]:
    """Rows of wiki/images: the original file of every image, one row a frame of what moves."""
    rows: list[Row] = []
    sprites = extraction.get("sprites", {})
    for element in extraction["elements"]:
        if element["kind"] not in ("image", "sprite", "animation"):
            continue
        base = {
            "page_id": page_id,
            "element_id": element["id"],
            "alt_text": element.get("alt") or None,
            "caption": element.get("caption") or None,
        }
        if element.get("frames"):
            for index, frame in enumerate(element["frames"]):
                if row := _file_row(frame.get("src"), files):
                    held = frame.get("duration")
                    alt = frame.get("alt") or base["alt_text"]
                    moment = {
                        "alt_text": alt,
                        "frame_index": index,
                        "frame_duration_ms": None if held is None else round(held),
                    }
                    rows.append({**base, **row, **moment})
            continue
        row = _file_row(element.get("src"), files)
        if row is None:
            continue
        pixels = sprites.get(str(element["id"]))
        if pixels:
            # An icon of a sheet: the cut-out pixels, not the sheet that it shares with the others.
            width, height = map(round, element["crop"]) if element.get("crop") else (None, None)
            row |= {
                "path": str(BELOW.images / f"{pixels}.png"),
                "sha256": pixels,
                "media_type": "image/png",
                "width": width,
                "height": height,
            }
        durations = () if pixels else _durations(element.get("src"), files)
        if durations:
            rows += [
                {**base, **row, "frame_index": index, "frame_duration_ms": held}
                for index, held in enumerate(durations)
            ]
        else:
            rows.append({**base, **row, "frame_index": None, "frame_duration_ms": None})
    return rows


def _file_row(src: str | None, files: Files) -> Row | None:
    if not src or not src.startswith(("http:", "https:")):
        return None
    key = addresses.original(src)
    held = files.get(key, {})
    names = ("path", "sha256", "media_type", "width", "height", "license")
    return {"src": held.get("url") or key, **{name: held.get(name) for name in names}}


def _durations(src: str | None, files: Files) -> list[int | None]:
    return files.get(addresses.original(src or ""), {}).get("frames") or []
