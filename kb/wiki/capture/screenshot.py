"""The whole page as one PNG: taken in tiles, checked, and joined in bounded memory.

A graphics path with a limit repeats or blanks what lies beyond it without a word. So every tile
of a tall page shows the first rows of the next one too, which are compared, and the last one is
compared with a thin strip of the same place, taken by itself: that one lies beyond any limit.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from kb.core.errors import Retryable
from kb.wiki.browser.browser import Browser
from kb.wiki.capture.png import Box, PixelRows, PngWriter

# CSS px. A browser paints the whole page anew for each picture, so that few tall ones cost least;
# a tile with its strip keeps within the lowest limit that was seen, 8,192.
STRIP = 16
TILE = 8192 - STRIP
MAX_CROP = 2048


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
    # While the browser takes a picture, a thread joins the one before.
    with PngWriter(path, width, height) as whole, ThreadPoolExecutor(1) as thread:
        joint = _Joint(whole, width, crops or {})
        behind: Future[None] | None = None
        for top, rows, more in _pictures(height):
            data = _capture(browser, top, width, rows + more)
            if behind is not None:
                behind.result()
            behind = thread.submit(joint.add, data, top, rows, more)
        if behind is not None:
            behind.result()
    return {key: encode(piece) for key, piece in joint.pieces.items()}


def tiles(height: int) -> int:
    """How many pictures a page of so many CSS px takes, the strip included."""
    return len(list(_pictures(height)))


def encode(image: Any) -> bytes:
    """A small Pillow image as PNG bytes."""
    held = io.BytesIO()
    image.save(held, "PNG", optimize=False)
    return held.getvalue()


def _pictures(height: int) -> Iterator[tuple[int, int, int]]:
    """(top, rows, rows of the next tile that it shows too) of each picture."""
    for top in range(0, height, TILE):
        rows = min(TILE, height - top)
        yield top, rows, min(STRIP, height - top - rows)
    if height > TILE:
        strip = min(STRIP, rows)
        yield height - strip, 0, strip


class _Joint:
    """Where pictures are compared, joined and cropped, from top to bottom."""

    def __init__(self, whole: PngWriter, width: int, crops: dict[int, Box]) -> None:
        from PIL import Image

        self._whole, self._width, self._crops = whole, width, crops
        self.pieces: dict[int, Any] = {
            key: Image.new("RGB", (right - left, bottom - top))
            for key, (left, top, right, bottom) in crops.items()
            if 0 < right - left <= MAX_CROP and 0 < bottom - top <= MAX_CROP
        }
        self._below: Any = None

    def add(self, data: bytes, top: int, rows: int, more: int) -> None:
        """Append the first `rows` of a picture (PNG bytes). Raises Retryable."""
        tile = PixelRows.read(data, self._width, rows + more)
        if self._below is not None:
            _compare(self._below, tile.part((0, 0, self._width, self._below.height)))
        if not rows:
            return
        end = rows + more
        self._below = tile.part((0, end - (more or min(STRIP, rows)), self._width, end))
        self._whole.add(tile, rows)
        for key, piece in self.pieces.items():
            left, upper, right, lower = self._crops[key]
            if upper < top + rows and lower > top:
                box = left, max(upper, top) - top, right, min(lower, top + rows) - top
                piece.paste(tile.part(box), (0, max(upper, top) - upper))


def _capture(browser: Browser, top: int, width: int, rows: int) -> bytes:
    answer = browser.devtools(
        "Page.captureScreenshot",
        {
            "format": "png",
            "captureBeyondViewport": True,
            "optimizeForSpeed": True,
            "clip": {"x": 0, "y": top, "width": width, "height": rows, "scale": 1},
        },
    )
    return base64.b64decode(answer["data"])


def _compare(one: Any, other: Any) -> None:
    """Two images of the same rows: what repeats or blanks shows."""
    from PIL import ImageChops

    if ImageChops.difference(one, other).getbbox():
        raise Retryable("screenshot_repeats: a tile does not show its part of the page")
