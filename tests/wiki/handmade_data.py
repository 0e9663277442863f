"""Raw answers of a wiki and captured pages, by hand: no browser and no wiki."""

import json
from pathlib import Path
from typing import Any

import zstandard

from kb.store.rawlog import rawlog

MONDAY, TUESDAY, FRIDAY = "2026-11-16T08:00:00Z", "2026-11-17T08:00:00Z", "2026-11-20T08:00:00Z"
WORDS = (
    "The kiln burns from the first frost to the thaw and every potter counts the wood of"
    " all of its firings in a book"
)
PICTURE = "http://wiki.example/images/Kiln.png"


def put(root: Path, kind: str, *answers: tuple[str, Any]) -> None:
    """One segment of (fetched_at, answer)."""
    segment = rawlog.Segment(rawlog.folder(root, "wiki", kind))
    for at, answer in answers:
        segment.append(
            rawlog.encode(
                rawlog.Envelope(
                    at, rawlog.Request("http://wiki.example/w/api.php", {"round": 1}), 200, answer
                )
            )
        )
    segment.close()


def page(key: int, title: str, revision: int = 1, **more: Any) -> dict[str, Any]:
    made = {"revid": revision, "timestamp": "2024-01-08T10:07:00Z"}
    return {
        "pageid": key,
        "ns": 0,
        "title": title,
        "fullurl": f"http://wiki.example/wiki/{title}",
        "revisions": [made],
        **more,
    }


def told(*pages: dict[str, Any]) -> dict[str, Any]:
    return {"batchcomplete": True, "query": {"pages": list(pages)}}


def captured(
    root: Path,
    key: int,
    title: str,
    revision: int = 1,
    text: str = WORDS,
    *,
    lines: list[list[float]] | None = None,
    more: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Writes a capture's extraction: a heading, a picture, a table of one cell; its answer.

    `lines` are those of the heading; `more` replaces parts of the extraction.
    """
    box = [0, 0.5, 100, 20]
    held = {"region": "content", "box": box, "visible": True, "level": None, "parent": None}
    elements = [
        {**held, "id": 0, "kind": "text", "tag": "p", "text": text}
        | ({"lines": lines} if lines else {}),
        {
            **held,
            "id": 1,
            "kind": "image",
            "tag": "img",
            "text": "",
            "src": PICTURE,
            "alt": "A kiln",
        },
        {**held, "id": 2, "kind": "table", "tag": "table", "text": ""},
        {**held, "id": 3, "kind": "cell", "tag": "td", "text": "hot", "parent": 2},
    ]
    cell = {
        "element": 3,
        "table": 2,
        "row": 0,
        "column": 0,
        "rowspan": 1,
        "colspan": 1,
        "header": False,
        "text": "hot",
        "box": box,
    }
    size = {"width": 1280, "height": 2000, "viewport_width": 1280, "device_pixel_ratio": 1}
    folder = f"raw/wiki/pages/{key}/{revision}"
    (root / folder).mkdir(parents=True, exist_ok=True)
    seen = {"page": size, "elements": elements, "cells": [cell], "sprites": {}}
    seen |= {"facts": [], "recipes": []} | (more or {})
    extraction = json.dumps(seen)
    (root / folder / "extraction.json.zst").write_bytes(
        zstandard.ZstdCompressor().compress(extraction.encode())
    )
    return {
        "page_id": key,
        "title": title,
        "url": f"http://wiki.example/wiki/{title}",
        "wanted_revision": revision,
        "outcome": "captured",
        "revision_id": revision,
        "folder": folder,
        "settled": False,
        "files": [{"key": PICTURE, "title": "File:Kiln.png", "src": PICTURE}],
    }


def refused(
    key: int, title: str, outcome: str, reason: str, value: Any = None, revision: int = 1
) -> dict[str, Any]:
    url = f"http://wiki.example/wiki/{title}"
    return {
        "page_id": key,
        "title": title,
        "url": url,
        "wanted_revision": revision,
        "outcome": outcome,
        "reason": reason,
        "value": value,
    }


def many(root: Path, count: int) -> None:
    """So many captured pages, each with a text of its own."""
    numbers = range(1000, 1000 + count)
    for start in range(0, count, 50):
        put(
            root,
            "pages",
            (
                MONDAY,
                told(*(page(number, f"Page {number}") for number in numbers[start : start + 50])),
            ),
        )
        shown = (
            captured(root, number, f"Page {number}", text=f"Kiln {number}. {WORDS}")
            for number in numbers[start : start + 50]
        )
        put(root, "renders", *((MONDAY, answer) for answer in shown))
