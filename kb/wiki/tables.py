"""One captured page → rows of the contract's tables. Pure: what the raw files say, nothing is asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.core import clock
from kb.core.errors import DamagedData
from kb.wiki import addresses

Row = dict[str, Any]
Files = Mapping[str, Row]
Size = Callable[[str], tuple[int, int]]


def read_extraction(folder: Path) -> Row:
    """What the page script saw. Raises DamagedData."""
    path = folder / "extraction.json.zst"
    try:
        return msgspec.json.decode(zstandard.ZstdDecompressor().decompressobj().decompress(path.read_bytes()))
    except (OSError, zstandard.ZstdError, msgspec.DecodeError) as error:
        raise DamagedData(f"{path} can't be read: {error}", hint="crawl again with --again") from None


def tops(elements: list[Row]) -> list[Row]:
    """Visible texts and cells that no other text or cell of the same table holds: every word once."""
    by_id = {element["id"]: element for element in elements}
    found = []
    for element in elements:
        if element["kind"] not in ("text", "cell") or not element["visible"]:
            continue
        parent = by_id.get(element["parent"])
        # A text never takes in what stands in a table, so a table between the two parts them.
        while parent is not None and parent["kind"] not in ("text", "cell", "table"):
            parent = by_id.get(parent["parent"])
        if parent is None or parent["kind"] == "table":
            found.append(element)
    return found


def page_text(elements: list[Row]) -> str:
    """The visible text of a page in reading order, a block a line."""
    return "\n".join(element["text"] for element in tops(elements) if element["text"])


def page_row(info: Row, render: Row, fetched_at: str, site: Row, extraction: Row) -> Row:
    """The row of `pages` without its scores."""
    page = extraction["page"]
    revision = info["revisions"][0]
    text = page_text(extraction["elements"])
    return {
        "page_id": int(render["page_id"]),
        "title": info["title"],
        "url": info["fullurl"],
        "revision_id": int(render["revision_id"]),
        "revision_timestamp": clock.parse(revision["timestamp"]),
        "fetched_at": clock.parse(fetched_at),
        "license": site.get("license"),
        "contributors_url": addresses.history(site["script"], info["title"]),
        "screenshot_path": f"{render['folder']}/screenshot.png",
        "page_width": int(page["width"]),
        "page_height": int(page["height"]),
        "viewport_width": int(page["viewport_width"]),
        "device_pixel_ratio": float(page["device_pixel_ratio"]),
        "word_count": len(text.split()),
    }


def element_rows(page_id: int, extraction: Row) -> list[Row]:
    """Rows of `elements`, in reading order."""
    rows = []
    for order, element in enumerate(extraction["elements"]):
        x, y, width, height = map(float, element["box"])
        held = element["text"] if element["kind"] in ("text", "cell", "sprite") else None
        rows.append(
            {
                "page_id": page_id,
                "element_id": element["id"],
                "parent_id": element["parent"],
                "kind": element["kind"],
                "tag": element["tag"],
                "region": element["region"],
                "heading_level": element["level"],
                "text": held,
                "x": x,
                "y": y,
                "width": width,
                "height": height,
                "visible": element["visible"],
                "reading_order": order,
            }
        )
    return rows


def cell_rows(page_id: int, extraction: Row) -> list[Row]:
    """Rows of `cells`, grid places from 0."""
    rows = []
    for cell in extraction["cells"]:
        x, y, width, height = map(float, cell["box"])
        rows.append(
            {
                "page_id": page_id,
                "table_id": cell["table"],
                "row_index": cell["row"],
                "column_index": cell["column"],
                "row_span": cell["rowspan"],
                "column_span": cell["colspan"],
                "is_header": cell["header"],
                "text": cell["text"],
                "x": x,
                "y": y,
                "width": width,
                "height": height,
            }
        )
    return rows


def image_rows(page_id: int, extraction: Row, files: Files) -> list[Row]:
    """Rows of `images`: the original file of every picture, one row a frame of what moves."""
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
                    rows.append(
                        {
                            **base,
                            **row,
                            "alt_text": frame.get("alt") or base["alt_text"],
                            "frame_index": index,
                            "frame_duration_ms": None if held is None else round(held),
                        }
                    )
            continue
        row = _file_row(element.get("src"), files)
        if row is None:
            continue
        pixels = sprites.get(str(element["id"]))
        if pixels:
            # An icon of a sheet: the cut-out pixels, not the sheet that it shares with all the others.
            box = [round(n) for n in element["crop"]] if element.get("crop") else None
            row |= {
                "path": f"raw/wiki/images/{pixels}.png",
                "sha256": pixels,
                "media_type": "image/png",
                "width": box[0] if box else None,
                "height": box[1] if box else None,
            }
        durations = () if pixels else _durations(element.get("src"), files)
        if durations:
            rows += [
                {**base, **row, "frame_index": index, "frame_duration_ms": held} for index, held in enumerate(durations)
            ]
        else:
            rows.append({**base, **row, "frame_index": None, "frame_duration_ms": None})
    return rows


def _file_row(src: str | None, files: Files) -> Row | None:
    if not src or not src.startswith(("http:", "https:")):
        return None
    key = addresses.original(src)
    held = files.get(key) or {}
    stored = held.get("outcome") == "stored"
    return {
        "src": held["url"] if stored else key,
        **{
            name: held.get(name) if stored else None
            for name in ("path", "sha256", "media_type", "width", "height", "license")
        },
    }


def _durations(src: str | None, files: Files) -> list[int | None]:
    held = files.get(addresses.original(src or ""), {})
    return held.get("frames") or [] if held.get("outcome") == "stored" else []


def site_facts(site: Row, url: str) -> Row:
    """What every page needs of the site's own description: its licence and its script's address."""
    general, rights = site.get("general", {}), site.get("rightsinfo", {})
    server = general.get("server") or url
    if server.startswith("//"):
        server = url.split("//", 1)[0] + server
    return {
        "license": addresses.licence(rights.get("url") or None, rights.get("text")),
        "script": server + (general.get("script") or "/index.php"),
    }
