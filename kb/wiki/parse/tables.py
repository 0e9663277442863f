"""Makes the tables of captured pages from their extractions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import zstandard

from kb.core.regular_file import read_regular
from kb.schema.tables import table
from kb.schema.wiki_page import is_outermost
from kb.store.damage import unreadable
from kb.store.layout import BELOW, Layout, parquet_files
from kb.store.rawlog import sidefiles
from kb.store.state import tombstones
from kb.store.tables import parquet
from kb.wiki import media_urls
from kb.wiki.markdown import page_markdown
from kb.wiki.parse import facts, graph
from kb.wiki.parse.decode import NAMES

Row = dict[str, Any]
Files = Mapping[str, Row]

PARTS = (
    *("wiki/elements", "wiki/cells", "wiki/images", "wiki/facts", "wiki/recipes"),
    *("wiki/page_text", "wiki/page_links", "wiki/categories", "wiki/redirects"),
    "wiki/recipe_edges",
)
LEAST_BYTES = 32 << 10  # counted for a small extraction: at most 256 pages to a bucket of 8 MB
SIDES = ("x", "y", "width", "height")
_FILE = "extraction.json.zst"


def read_extraction(root: Path, folder: Path) -> dict[str, Any]:
    """The extraction in a page's folder: sizes of the `page`, its `elements` in document order,
    `cells` of tables, `sprites`, `facts` and `recipes`.

    Raises DamagedData, and notes the page for the next crawl.
    """
    path = folder / _FILE
    try:
        text = zstandard.ZstdDecompressor().decompressobj().decompress(read_regular(path))
        content: dict[str, Any] = msgspec.json.decode(text)
    except (OSError, zstandard.ZstdError, msgspec.DecodeError) as error:
        damage = sidefiles.lost(root, "wiki", [path])
        damage.args = unreadable(path, error).args
        raise damage from None
    return content


def size(root: Path) -> int:
    """Bytes of all extractions, as raw data that a bucket must hold."""
    return sum(
        max(path.stat().st_size, LEAST_BYTES)
        for path in Layout(root).captures.glob("*/*/extraction.json.zst")
    )


def read_pages(
    root: Path, rows: dict[str, Any], follows: bool, *, rules: facts.MarkupRules
) -> dict[str, Any]:
    """Pages with sizes, `text` and `word_count`; with `follows` also the tables of PARTS.

    `rows` is the result of kb.wiki.parse.decode. A page that was not captured gets nulls.
    `rules` tell names and units of facts and recipes. Raises DamagedData.
    """
    pages = rows["wiki/pages"]
    files = {row["key"]: row for row in rows["files"].to_pylist() if row["path"] is not None}
    parts = {name: [table(name).arrow().empty_table()] for name in PARTS}
    measured = [
        figure for figure in table("wiki/pages").columns if figure.source.kind == "extraction"
    ]
    names = ("screenshot_path", *(figure.name for figure in measured), "word_count", "text")
    columns: dict[str, list[Any]] = {name: [] for name in names}
    wanted = ["page_id", "folder", "title", "revision_id", *NAMES]
    removed = tombstones.keys(root, "wiki") if follows else ()
    for page in pages.select(wanted).to_pylist():
        values: Row = {}
        if page["folder"] is not None:
            seen = read_extraction(root, sidefiles.captured_path(root, page["folder"]))
            text = page_text(seen["elements"])
            values = {"text": text, "word_count": len(text.split())}
            values["screenshot_path"] = f"{page['folder']}/screenshot.png"
            for figure in measured:
                # Sizes may be stored as 1280.0, which Arrow rejects as an integer.
                kind = float if figure.type.startswith("float") else int
                value = seen["page"].get(figure.source.path.removeprefix("page."))
                values[figure.name] = value if value is None else kind(value)
            for name, part in _parts(page, seen, files, rules, removed) if follows else ():
                parts[name].append(part)
        for name, column in columns.items():
            column.append(values.get(name))
    types = {column.name: column.parsed.arrow() for column in table("wiki/pages").columns}
    for name, column in columns.items():
        pages = pages.append_column(name, pa.array(column, types.get(name, pa.string())))
    if not follows:
        return {"wiki/pages": pages}
    joined = {name: pa.concat_tables(part).combine_chunks() for name, part in parts.items()}
    return {"wiki/pages": pages, **joined}


def _parts(
    page: Row, seen: Row, files: Files, rules: facts.MarkupRules, removed: Collection[str]
) -> Iterator[tuple[str, pa.Table]]:
    key = page["page_id"]
    columns = {
        "elements": elements(key, seen["elements"], rules),
        "cells": cells(key, seen["cells"]),
    }
    slots = facts.recipes(page, seen["recipes"], rules)
    rows: dict[str, Iterable[Row]] = {
        "images": image_rows(key, seen, files),
        "facts": facts.facts(page, seen["facts"], rules),
        "recipes": slots,
        "page_links": graph.page_links(key, seen["elements"]),
        "recipe_edges": graph.recipe_edges(
            slots,
            seen["elements"],
            [recipe.get("shape", ()) for recipe in seen["recipes"]],
            rules.stations,
        ),
        **graph.names(page, removed),
    }
    for short, part in rows.items():
        columns[short] = _table_of(f"wiki/{short}", list(part))
    text = page_markdown(page["title"], columns)
    words = {"page_id": key, "text": text, "word_count": len(text.split())}
    columns["page_text"] = _table_of("wiki/page_text", [words])
    yield from ((f"wiki/{short}", part) for short, part in columns.items())


def _table_of(name: str, rows: list[Row]) -> pa.Table:
    return pa.Table.from_pylist(rows, table(name).arrow())


def figures(clean: Path) -> dict[str, int]:
    """For the summary of a filter: rows of kept pages' infoboxes that could not be read."""
    parts = (parquet.read_table(path, ["unread_facts"]) for path in parquet_files(clean / "pages"))
    return {"unread_facts": sum(pc.sum(part["unread_facts"]).as_py() or 0 for part in parts)}


def page_text(elements: list[Row]) -> str:
    """The text of a page in reading order, what is folded included, a block a line: texts and
    cells that no other one of the same table contains, so that every word counts once.
    """
    parents = {element["id"]: element["parent"] for element in elements}
    kinds = {element["id"]: element["kind"] for element in elements}
    return "\n".join(
        element["text"]
        for element in elements
        if (element["visible"] or element.get("folded"))
        and element["kind"] in ("text", "cell")
        and element["text"]
        and is_outermost(element["id"], parents, kinds)
    )


def elements(page_id: int, entries: list[Row], rules: facts.MarkupRules) -> pa.Table:
    """Rows of wiki/elements of a page, in reading order."""
    texts: list[str | None] = []
    lines: list[list[Row] | None] = []
    marks: list[list[Row] | None] = []
    for entry in entries:
        text = entry["text"] if entry["kind"] in ("text", "cell", "sprite") else None
        texts.append(facts.name_inside(text, rules.item) if entry["kind"] == "sprite" else text)
        # Images and hidden text have no lines.
        boxes = entry.get("lines")
        lines.append(
            None if boxes is None else [dict(zip(SIDES, box, strict=True)) for box in boxes]
        )
        marks.append(_marks(entry.get("marks") or (), rules) or None)
    made: dict[str, list[Any]] = {"text": texts, "lines": lines, "marks": marks}
    order = list(range(len(entries)))
    return _made("wiki/elements", page_id, entries, reading_order=order, **made)


def _marks(pins: Iterable[Any], rules: facts.MarkupRules) -> list[Row]:
    """Links to pages that are there, and icons."""
    return [
        {
            "start": start,
            "end": end,
            "title": facts.name_inside(title, rules.item) if start == end else title,
        }
        for start, end, title, *absent in pins
        if not absent
    ]


def cells(page_id: int, entries: list[Row]) -> pa.Table:
    """Rows of wiki/cells of a page, grid places from 0."""
    row, column = ([entry[name] for entry in entries] for name in ("row", "column"))
    return _made("wiki/cells", page_id, entries, row_index=row, column_index=column)


def _made(name: str, page_id: int, entries: list[Row], **made: list[Any]) -> pa.Table:
    """A table of a page's entries; `made` are the columns that rules make."""
    made["page_id"] = [page_id] * len(entries)
    arrays = []
    for column in table(name).columns:
        field = column.source.path.partition("[].")[2]
        if column.name in made:
            values = made[column.name]
        elif field == "box":
            side = SIDES.index(column.name)
            values = [entry["box"] and entry["box"][side] for entry in entries]
        elif field == "folded":  # in no extraction of earlier versions
            values = [entry.get(field, False) for entry in entries]
        elif column.nullable:
            values = [entry.get(field) for entry in entries]
        else:
            values = [entry[field] for entry in entries]
        arrays.append(pa.array(values, column.parsed.arrow()))
    return pa.table(arrays, schema=table(name).arrow())


def image_rows(page_id: int, seen: Row, files: Files) -> list[Row]:
    """Rows of wiki/images: the original file of every image, one row a frame of an animation."""
    rows: list[Row] = []
    for element in seen["elements"]:
        if element["kind"] not in ("image", "sprite", "animation"):
            continue
        base = {
            "page_id": page_id,
            "element_id": element["id"],
            "alt_text": element.get("alt") or None,
            "caption": element.get("caption") or None,
        }
        if frames := element.get("frames"):
            for index, frame in enumerate(frames):
                if row := _file_row(frame, files):
                    duration = frame.get("duration")
                    row["alt_text"] = frame.get("alt") or base["alt_text"]
                    row["frame_index"] = index
                    row["frame_duration_ms"] = None if duration is None else round(duration)
                    rows.append({**base, **row})
            continue
        row = _file_row(element, files)
        if row is None:
            continue
        durations = row["frames"] or ()
        if pixels := seen["sprites"].get(str(element["id"])):
            # An icon of a sprite sheet: the cropped pixels, not the sheet with all icons.
            crop = element.get("crop")
            width, height = map(round, crop) if crop else (None, None)
            row |= {
                "path": str(BELOW.images / f"{pixels}.png"),
                "sha256": pixels,
                "media_type": "image/png",
                "width": width,
                "height": height,
            }
            durations = ()
        moments = list(enumerate(durations)) if durations else [(None, None)]
        rows += [
            {**base, **row, "frame_index": index, "frame_duration_ms": duration}
            for index, duration in moments
        ]
    return rows


def _file_row(image: Row, files: Files) -> Row | None:
    key = media_urls.file_key(image)
    if key is None:
        return None
    stored = files.get(key, {})
    names = ("path", "sha256", "media_type", "width", "height", "license", "frames")
    return {"src": stored.get("url") or key, **{name: stored.get(name) for name in names}}
