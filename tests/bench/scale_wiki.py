"""Captured wiki pages of the paper's shape at any share of its size, as a crawl stores them:
answers about pages, what became of showing them, and a folder for each page.

Elements, tables and sizes are drawn so that 6,735 pages have 2.2 million elements together; each
page has its own seed, so the same share gives the same bytes.
"""

import hashlib
import random
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import zstandard

from kb.store.rawlog import sidefiles
from kb.store.rawlog.rawlog import SUFFIX, compressor
from tests.bench.scale_raw import Part, Words

PAGES = 6_735
ROOT = "https://minecraft.wiki"
SIDE = 16  # px of the only icon

_PACK = 50  # pages an answer
_SEGMENT = 500  # pages a part
_AT = "2026-11-20T12:00:00Z"


def parts(share: float) -> list[Part]:
    """The parts of a share: some pages each, with a segment of every kind."""
    pages = round(PAGES * share)
    return [
        Part("wiki", "pages", number, first, min(first + _SEGMENT, pages))
        for number, first in enumerate(range(0, pages, _SEGMENT), 1)
    ]


def write(root: Path, part: Part) -> None:
    """Write the segments and the folders of one part."""
    asked, shown = [], []
    for number in range(part.first, part.after):
        chance = random.Random(f"wiki {number}")
        words = Words(chance.getrandbits(32))
        title = f"{words.text(2).title()} {number}"
        asked.append(_asked(number, title))
        shown.append(_shown(root, number, title, chance, words))
    answers = [
        _envelope(
            "api.php",
            {"titles": "|".join(page["title"] for page in pack), "round": "1"},
            {"batchcomplete": True, "query": {"pages": pack}},
        )
        for pack in _packs(asked)
    ]
    _segment(root, "pages", part.number, answers)
    _segment(root, "renders", part.number, shown)
    if part.number == 1:
        _segment(root, "site", 1, [_site()])
        _segment(root, "files", 1, [_icon(root)])


def _packs(pages: list[Any]) -> Iterator[list[Any]]:
    for first in range(0, len(pages), _PACK):
        yield pages[first : first + _PACK]


def _segment(root: Path, kind: str, number: int, envelopes: list[Any]) -> None:
    folder = root / "raw" / "wiki" / kind
    folder.mkdir(parents=True, exist_ok=True)
    engine = compressor()
    with (folder / f"{number:06d}-5eed0000{SUFFIX}").open("wb") as file:
        for envelope in envelopes:
            file.write(engine.compress(orjson.dumps(envelope) + b"\n"))


def _envelope(endpoint: str, params: dict[str, Any], response: Any) -> Any:
    return {
        "fetched_at": _AT,
        "request": {"endpoint": f"{ROOT}/w/{endpoint}", "params": params},
        "status": 200,
        "response": response,
    }


def _asked(number: int, title: str) -> dict[str, Any]:
    place = title.replace(" ", "_")
    revision = {"revid": 10 * number + 1, "parentid": 0, "user": "A", "timestamp": _AT, "size": 9}
    return {
        "pageid": number + 1,
        "ns": 0,
        "title": title,
        "contentmodel": "wikitext",
        "pagelanguage": "en",
        "pagelanguagehtmlcode": "en",
        "pagelanguagedir": "ltr",
        "touched": _AT,
        "lastrevid": 10 * number + 1,
        "length": 9,
        "fullurl": f"{ROOT}/w/{place}",
        "editurl": f"{ROOT}/index.php?title={place}&action=edit",
        "canonicalurl": f"{ROOT}/w/{place}",
        "revisions": [revision],
    }


def _shown(root: Path, number: int, title: str, chance: random.Random, words: Words) -> Any:
    """A page's folder, and the envelope about it."""
    key, revision = number + 1, 10 * number + 1
    below = Path("raw", "wiki", "pages", str(key), str(revision))
    folder = root / below
    folder.mkdir(parents=True, exist_ok=True)
    elements, cells, height = _elements(chance, words)
    page = {
        "device_pixel_ratio": 1,
        "height": height,
        "page_id": key,
        "redirected_from": None,
        "revision_id": revision,
        "title": title,
        "truncated": False,
        "url": f"{ROOT}/w/{title.replace(' ', '_')}",
        "viewport_width": 1280,
        "width": 1280,
    }
    pack = zstandard.ZstdCompressor(level=3, write_checksum=True)
    extraction = {"cells": cells, "elements": elements, "page": page, "sprites": {}}
    extraction |= {"facts": [], "recipes": []}
    html = "".join(f"<p>{element['text'] or ''}</p>" for element in elements).encode()
    (folder / "extraction.json.zst").write_bytes(pack.compress(orjson.dumps(extraction)))
    (folder / "page.html.zst").write_bytes(pack.compress(html))
    (folder / "screenshot.png").write_bytes(_picture(1280, height, chance))
    sidefiles.write_sums(folder)
    answer = {
        "page_id": key,
        "title": title,
        "url": page["url"],
        "wanted_revision": revision,
        "tries": 1,
        "outcome": "captured",
        "revision_id": revision,
        "folder": str(below),
        "settled": True,
        "elements": len(elements),
        "files": [{"key": f"{ROOT}/images/Icon.png", "title": "File:Icon.png", "src": ""}],
        "seconds": {"load": 1.0},
    }
    return _envelope(page["url"], {"page_id": str(key)}, answer)


def _elements(
    chance: random.Random, words: Words
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], int]:
    """Headings, paragraphs, pictures, and tables of which a row is a sixth of a page's elements."""
    count = max(8, int(chance.lognormvariate(5.29, 1.0)))  # mean: 327, 2.2 million in all
    elements: list[dict[str, Any]] = []
    cells: list[dict[str, Any]] = []
    top, table = 100.0, -1

    def add(kind: str, tag: str, box: list[float], text: str | None, **more: Any) -> int:
        element = {
            "box": box,
            "id": len(elements),
            "kind": kind,
            "level": None,
            "parent": None,
            "region": "content",
            "tag": tag,
            "text": text,
            "visible": True,
            "folded": False,
            **more,
        }
        elements.append(element)
        return len(elements) - 1

    add("text", "h1", [90, 32.09, 1100, 45], words.text(3), level=1)
    while len(elements) < count:
        kind = chance.random()
        if kind < 0.1:
            columns, rows = chance.randint(2, 6), chance.randint(2, 12)
            table = add("table", "table", [90, top, 900, rows * 30.0], None)
            for row in range(rows):
                for column in range(columns):
                    box, text = [90.0 + 150 * column, top, 150, 30.0], words.text(3)
                    cell = add("cell", "td", box, text, parent=table)
                    cells.append(
                        {
                            "element": cell,
                            "box": box,
                            "colspan": 1,
                            "column": column,
                            "header": row == 0,
                            "row": row,
                            "rowspan": 1,
                            "table": table,
                            "text": text,
                        }
                    )
                top += 30
        elif kind < 0.3:
            more = {"alt": words.text(3), "caption": None, "file": None, "loaded": True}
            src = f"{ROOT}/images/Icon.png"
            add("image", "img", [90, top, 300, 169], None, **more, natural=[16, 16], src=src)
            top += 60
        else:
            add("text", "p", [90, top, 1100, 22.5], words.text(chance.randint(3, 40)))
            top += 32
    return elements, cells, min(90_000, int(top) + 200)


def _picture(width: int, height: int, chance: random.Random) -> bytes:
    """A PNG of which every tenth row is noise: about 0.4 MB for 1,000 px, as of real pages."""
    noise = np.random.default_rng(chance.getrandbits(32))
    rows = np.zeros((height, 1 + width * 3), np.uint8)
    rows[::10, 1:] = noise.integers(0, 256, (len(rows[::10]), width * 3), np.uint8)
    return _png(width, height, rows.tobytes())


def _png(width: int, height: int, rows: bytes) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def _icon(root: Path) -> Any:
    data = _png(SIDE, SIDE, bytes(SIDE * (1 + SIDE * 3)))
    name = hashlib.sha256(data).hexdigest()
    folder = root / "raw" / "wiki" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.png").write_bytes(data)
    answer = {
        "key": f"{ROOT}/images/Icon.png",
        "title": "File:Icon.png",
        "license": None,
        "description": f"{ROOT}/w/File:Icon.png",
        "outcome": "stored",
        "sha1": None,
        "url": f"{ROOT}/images/Icon.png",
        "sha256": name,
        "bytes": len(data),
        "media_type": "image/png",
        "path": f"raw/wiki/images/{name}.png",
        "width": SIDE,
        "height": SIDE,
        "frames": [],
    }
    return _envelope("images", {}, answer)


def _site() -> Any:
    general = {"server": ROOT, "script": "/w/index.php", "sitename": "Wiki"}
    rights = {"url": "https://creativecommons.org/licenses/by-nc-sa/3.0/", "text": "CC BY-NC-SA"}
    answer = {"batchcomplete": True, "query": {"general": general, "rightsinfo": rights}}
    return _envelope("api.php", {"meta": "siteinfo"}, answer)
