"""The whole page as one PNG: taken in tiles, checked, and joined in bounded memory.

A graphics path with a limit repeats or blanks what lies beyond it without a word. So every tile
of a tall page shows the first rows of the next one too, which are compared, and the last one is
compared with a thin strip of the same place, taken by itself: that one lies beyond any limit. A
strip costs the browser as much as a tile, so there is no more than one.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from kb.core.errors import Retryable
from kb.wiki.browser import Browser
from kb.wiki.png import PngWriter

TILE = 4096  # CSS px, half of the lowest limit that was seen
STRIP = 16
MAX_CROP = 2048

Box = tuple[int, int, int, int]


def snapped(box: Iterable[float]) -> Box:
    """(left, top, right, bottom) of a box (x, y, width, height) as the browser paints it: edges go
    to the nearest pixel.
    """
    x, y, width, height = box
    return (
        math.floor(x + 0.5),
        math.floor(y + 0.5),
        math.floor(x + width + 0.5),
        math.floor(y + height + 0.5),
    )


def take(
    browser: Browser, path: Path, width: int, height: int, crops: dict[int, Box] | None = None
) -> dict[int, bytes]:
    """Write the image to `path`; the PNG bytes of each crop.

    `width` and `height` are the page's (CSS px, one image px each). Raises Retryable when the
    image is not the page.
    """
    from PIL import Image

    pieces: dict[int, Any] = {
        key: Image.new("RGB", (right - left, bottom - top))
        for key, (left, top, right, bottom) in (crops or {}).items()
        if 0 < right - left <= MAX_CROP and 0 < bottom - top <= MAX_CROP
    }
    below = None
    with PngWriter(path, width, height) as png:
        for top in range(0, height, TILE):
            rows = min(TILE, height - top)
            more = min(STRIP, height - top - rows)
            tile = _capture(browser, top, width, rows + more)
            if below is not None:
                _compare(below, tile.crop((0, 0, width, below.height)))
            if more:
                below = tile.crop((0, rows, width, rows + more))
                tile = tile.crop((0, 0, width, rows))
            elif height > TILE:
                strip = min(STRIP, rows)
                alone = _capture(browser, height - strip, width, strip)
                _compare(alone, tile.crop((0, rows - strip, width, rows)))
            png.add(tile)
            for key, piece in pieces.items():
                left, upper, right, lower = (crops or {})[key]
                if upper < top + rows and lower > top:
                    part = tile.crop(
                        (left, max(upper, top) - top, right, min(lower, top + rows) - top)
                    )
                    piece.paste(part, (0, max(upper, top) - upper))
    return {key: encode(piece) for key, piece in pieces.items()}


def tiles(height: int) -> int:
    """How many pictures a page of so many CSS px takes, the strip included."""
    return -(-height // TILE) + (height > TILE)


def encode(image: Any) -> bytes:
    """A small Pillow image as PNG bytes."""
    held = io.BytesIO()
    image.save(held, "PNG", optimize=False)
    return held.getvalue()


def _capture(browser: Browser, top: int, width: int, rows: int) -> Any:
    from PIL import Image

    answer = browser.devtools(
        "Page.captureScreenshot",
        {
            "format": "png",
            "captureBeyondViewport": True,
            "optimizeForSpeed": True,
            "clip": {"x": 0, "y": top, "width": width, "height": rows, "scale": 1},
        },
    )
    # The size is checked in the header before anything is decoded.
    image = Image.open(io.BytesIO(base64.b64decode(answer["data"])))
    if image.size != (width, rows):
        raise Retryable(
            f"screenshot_size: {image.size[0]} × {image.size[1]} instead of {width} × {rows} px"
        )
    return image.convert("RGB")


def _compare(one: Any, other: Any) -> None:
    """Two images of the same rows: what repeats or blanks shows."""
    from PIL import ImageChops

    if ImageChops.difference(one, other).getbbox():
        raise Retryable("screenshot_repeats: a tile does not show its part of the page")
