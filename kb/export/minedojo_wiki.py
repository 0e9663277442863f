"""`--format minedojo`: the wiki in the layout of the published MineDojo data.

    export/minedojo/wiki_full/<title as in the page's address>/data.json, screenshot.png, images/
    {"metadata": {url, title, time},
     "tables": [{bbox, headers {text, bboxes}, cells {text, bboxes}}],
     "images": [{src, path, alt_text, caption, bbox}],
     "sprites": [{text, bbox}], "texts": [{text, bbox}]}
    export/minedojo/wiki_samples/         the first pages, which its loader reads with full=False

bbox is [x, y, w, h] in pixels of the screenshot, x and y floats, w and h whole. Texts: none inside
of a table, and none that another one holds (a list and its items: the list). Null where a caption
or a sprite's text is not there. Files are ASCII. Pillow refuses screenshots above 178.9 megapixels
(`Image.MAX_IMAGE_PIXELS`), so the published loader does too. Source: "MineDojo: Building Open-Ended
Embodied Agents with Internet-Scale Knowledge" (NeurIPS 2022), data appendix. Only what the
screenshot shows is in it, as there. SVG files, which its loader can't open, are given as the
screenshot shows them.
"""

import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from kb.core.context import Run
from kb.core.summary import Summary
from kb.export.rows import Row, check_rows, sorted_rows
from kb.schema.nested_elements import ancestors
from kb.store.atomic import replacing_folder
from kb.store.layout import CAPTURED, Layout
from kb.store.rawlog import sidefiles
from kb.store.rawlog.sidefiles import captured_path
from kb.store.tables.merge import RowsByKey

_SAMPLES = 10  # pages
_BOX = ["x", "y", "width", "height"]


def wiki(run: Run) -> Summary:
    """Writes wiki_full and wiki_samples from clean/wiki, one page at a time. Raises FatalError
    without clean rows, and DiskFull.
    """
    check_rows(run.root, "wiki/pages")
    target = Layout(run.root).export("minedojo", "wiki_full")
    count, taken, samples = 0, set(), []
    pages = sorted_rows(
        run.root,
        "wiki/pages",
        ["page_id", "title", "url", "fetched_at", "screenshot_path"],
        ["page_id"],
    )
    elements = _by_page(
        run,
        "wiki/elements",
        ("reading_order",),
        ("element_id", "parent_id", "kind", "text", *_BOX, "visible"),
    )
    cells = _by_page(
        run,
        "wiki/cells",
        ("table_id", "row_index", "column_index"),
        ("is_header", "text", *_BOX),
    )
    images = _by_page(
        run,
        "wiki/images",
        ("element_id", "frame_index"),
        ("src", "path", "sha256", "media_type", "alt_text", "caption"),
    )
    with replacing_folder(target) as fresh:
        for page in pages:
            name = folder_name(page["url"], page["title"])
            if (
                name.casefold() in taken
            ):  # addresses that differ by case only, on file systems that don't
                name = f"{name}~{page['page_id']}"
            taken.add(name.casefold())
            if count < _SAMPLES:
                samples.append(name)
            folder = fresh / name
            (folder / "images").mkdir(parents=True)
            _copy(run.root, page["screenshot_path"], folder / "screenshot.png")
            key = page["page_id"]
            rows = (list(table.of(key)) for table in (elements, cells, images))
            data = _data(run.root, folder, page, *rows)
            (folder / "data.json").write_text(json.dumps(data, indent=2), encoding="ascii")
            count += 1
    with replacing_folder(target.with_name("wiki_samples")) as fresh:
        for name in samples:  # a subpage's folder is inside of its page's, and not part of it
            shutil.copytree(target / name / "images", fresh / name / "images")
            for file in ("data.json", "screenshot.png"):
                shutil.copyfile(target / name / file, fresh / name / file)
    return Summary(format="minedojo", pages=count, path=str(target))


def _by_page(run: Run, name: str, order: Sequence[str], columns: Sequence[str]) -> RowsByKey:
    by = ["page_id", *order]
    return RowsByKey(sorted_rows(run.root, name, [*by, *columns], by), "page_id")


def folder_name(url: str, title: str) -> str:
    """The page's folder: its title as the address has it, percent-encoded ("Caf%C3%A9").

    A subpage is a folder below its page's. What the address leaves as it is and a file system or
    the published loader can't have (a colon, a leading dot) is percent-encoded too, so that no step
    leads elsewhere and each leads back to its address.
    """
    parts = urlsplit(url)
    steps = [step for step in parts.path.split("/") if step]
    named = [step for step in title.split("/") if step]
    if parts.query:  # index.php?title=…: the path is the same for all
        steps = [quote(step.replace(" ", "_"), safe="") for step in named]
    # What stands before the title ("/wiki/") is the site's own.
    words = title.replace("_", " ")
    tails = (steps[-count:] for count in range(1, len(steps) + 1))
    exact = (tail for tail in tails if unquote("/".join(tail)).replace("_", " ") == words)
    steps = next(exact, steps[-max(1, len(named)) :])
    return str(Path(*(_short(_plain(step)) for step in steps or "_")))


def _plain(step: str) -> str:
    """A step that is a plain name: no file system's own characters, no dot at its start."""
    quoted = quote(step, safe="%!$&'()+,;=@~")
    return re.sub(r"^\.", "%2E", quoted)


def _short(step: str) -> str:
    raw = step.encode()
    return (
        step
        if len(raw) <= 200
        else f"{raw[:180].decode(errors='ignore')}~{hashlib.sha256(raw).hexdigest()[:12]}"
    )


def box(row: Row) -> list[float | int]:
    """[x, y, w, h] in pixels: x and y floats, w and h whole and at least 1."""
    return [
        float(row["x"]),
        float(row["y"]),
        max(1, round(row["width"])),
        max(1, round(row["height"])),
    ]


def _data(
    root: Path, folder: Path, page: Row, elements: list[Row], cells: list[Row], images: list[Row]
) -> Row:
    seen = {row["element_id"]: row for row in elements if row["visible"]}
    of_table = {
        number: list(group) for number, group in groupby(cells, key=lambda row: row["table_id"])
    }
    shown = [
        row
        for row in images
        if row["element_id"] in seen
        and seen[row["element_id"]]["kind"] != "sprite"
        and not row["frame_index"]
    ]
    return {
        "metadata": {
            "url": page["url"],
            "title": page["title"],
            "time": page["fetched_at"].strftime("%d/%m/%Y %H:%M:%S"),
        },
        "tables": [
            _table(row, of_table.get(row["element_id"], []))
            for row in seen.values()
            if row["kind"] == "table"
        ],
        "images": [
            image for row in shown if (image := _image(root, folder, row, seen[row["element_id"]]))
        ],
        "sprites": [
            {"text": row["text"] or None, "bbox": box(row)}
            for row in seen.values()
            if row["kind"] == "sprite"
        ],
        "texts": [{"text": row["text"], "bbox": box(row)} for row in own_texts(elements)],
    }


def own_texts(elements: list[Row]) -> list[Row]:
    """Shown text elements that are in no table, and whose words no text around them contains."""
    every = {row["element_id"]: row for row in elements}
    parents = {key: row["parent_id"] for key, row in every.items()}
    words = {
        key: _words(row["text"])
        for key, row in every.items()
        if row["kind"] == "text" and row["visible"] and row["text"]
    }
    return [
        every[key]
        for key, text in words.items()
        if not any(
            every[above]["kind"] in ("table", "cell") or text in words.get(above, "")
            for above in ancestors(key, parents)
        )
    ]


def _words(text: str) -> str:
    """The text without its spaces, which differ by how lines break."""
    return "".join(text.split())


def _table(row: Row, cells: list[Row]) -> Row:
    cells = [cell for cell in cells if cell["x"] is not None]  # folded ones have no box
    parts = {
        True: [cell for cell in cells if cell["is_header"]],
        False: [cell for cell in cells if not cell["is_header"]],
    }
    by_kind = {
        kind: {"text": [cell["text"] for cell in part], "bboxes": [box(cell) for cell in part]}
        for kind, part in parts.items()
    }
    return {"bbox": box(row), "headers": by_kind[True], "cells": by_kind[False]}


def _image(root: Path, folder: Path, row: Row, element: Row) -> Row | None:
    """One image with its file beside the page; None where the wiki could not give the file."""
    if not row["path"]:
        return None
    source = captured_path(root, row["path"])
    name = source.name
    if row["media_type"] == "image/svg+xml":
        name = f"{row['sha256']}-{row['element_id']}.png"
        _crop(folder / "screenshot.png", box(element), folder / "images" / name)
    elif not (folder / "images" / name).exists():
        _copy(root, row["path"], folder / "images" / name)
    return {
        "src": row["src"],
        "path": f"images/{name}",
        "alt_text": row["alt_text"] or "",
        "caption": row["caption"] or None,
        "bbox": box(element),
    }


def _copy(root: Path, path: str, target: Path) -> None:
    """A file beside the raw log. Raises DamagedData for one that is not what was stored."""
    file = captured_path(root, path)
    if not sidefiles.is_intact(file):
        raise sidefiles.lost(root, CAPTURED, [file])
    shutil.copyfile(file, target)


def _crop(screenshot: Path, where: list[float | int], target: Path) -> None:
    from PIL import Image

    limit, Image.MAX_IMAGE_PIXELS = (
        Image.MAX_IMAGE_PIXELS,
        None,
    )  # our own image, whose size the crawl has checked
    try:
        with Image.open(screenshot) as image:
            x, y, width, height = map(round, where)
            image.crop((x, y, x + width, y + height)).save(target, "PNG")
    finally:
        Image.MAX_IMAGE_PIXELS = limit
