"""Takes a screenshot of a whole page: tiles from the browser, checked and joined to one PNG.

A graphics path with a size limit silently repeats or blanks whatever lies beyond it. Each tile of a
tall page therefore overlaps the next one by a strip, and the two are compared. The end of the last
tile is compared with a strip captured separately, which is small enough for any limit.

The image is written a tile at a time, so memory does not grow with the height of the page.
"""

from __future__ import annotations

import base64
import io
import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Self

from kb.core.errors import Retryable
from kb.wiki.browser.browser import Browser
from kb.wiki.errors import PageMoved

# CSS px. The browser paints the whole page for every tile, so few tall tiles are cheapest. A tile
# with its strip stays within 8,192, the lowest limit observed.
STRIP = 16
TILE = 8192 - STRIP
MAX_CROP = 2048
_COMPRESSION = 4  # screenshots are flat: higher levels gain little
_FILTER_UP = 2  # PNG filter: each byte is the difference to the one above

Box = tuple[int, int, int, int]


def pixel_box(box: Iterable[float]) -> Box:
    """Convert (x, y, width, height) to (left, top, right, bottom) with edges on whole pixels, as
    the browser paints them.
    """
    x, y, width, height = box
    return (
        math.floor(x + 0.5),
        math.floor(y + 0.5),
        math.floor(x + width + 0.5),
        math.floor(y + height + 0.5),
    )


def take_screenshot(
    browser: Browser, path: Path, width: int, height: int, crops: dict[int, Box] | None = None
) -> dict[int, bytes]:
    """Write the screenshot to `path` and return the PNG bytes of each crop.

    `width` and `height` are the page's, in CSS px, which equal image px. Raises Retryable when the
    image does not match the page.
    """
    from PIL import Image, ImageChops

    crops = crops or {}
    pieces: dict[int, Any] = {
        key: Image.new("RGB", (right - left, bottom - top))
        for key, (left, top, right, bottom) in crops.items()
        if 0 < right - left <= MAX_CROP and 0 < bottom - top <= MAX_CROP
    }
    strip: Any = None  # what the next tile must begin with
    with PngWriter(path, width, height) as png:
        for top, rows, overlap in _tiles(height):
            end = rows + overlap
            answer = browser.devtools(
                "Page.captureScreenshot",
                {
                    "format": "png",
                    "captureBeyondViewport": True,
                    "optimizeForSpeed": True,
                    "clip": {"x": 0, "y": top, "width": width, "height": end, "scale": 1},
                },
            )
            tile = decode_tile(base64.b64decode(answer["data"]), width, end)
            if strip is not None:
                shared = tile.crop((0, 0, width, strip.height))
                if ImageChops.difference(strip, shared).getbbox():
                    raise PageMoved("screenshot_repeats: a tile does not show its part of the page")
            if not rows:
                continue
            strip = tile.crop((0, end - (overlap or min(STRIP, rows)), width, end))
            png.add_tile(tile.crop((0, 0, width, rows)))
            for key, piece in pieces.items():
                left, upper, right, lower = crops[key]
                if upper < top + rows and lower > top:
                    box = left, max(upper, top) - top, right, min(lower, top + rows) - top
                    piece.paste(tile.crop(box), (0, max(upper, top) - upper))
    return {key: encode_png(piece) for key, piece in pieces.items()}


def count_tiles(height: int) -> int:
    """Return how many captures a page of `height` CSS px takes, including the separate strip."""
    return len(list(_tiles(height)))


def encode_png(image: Any) -> bytes:
    """Encode a small Pillow image as PNG."""
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=False)
    return buffer.getvalue()


def _tiles(height: int) -> Iterator[tuple[int, int, int]]:
    """Yield (top, rows, rows shared with the next tile) of each capture."""
    for top in range(0, height, TILE):
        rows = min(TILE, height - top)
        yield top, rows, min(STRIP, height - top - rows)
    if height > TILE:
        strip = min(STRIP, rows)
        yield height - strip, 0, strip


def decode_tile(data: bytes, width: int, height: int) -> Any:
    """Decode PNG bytes to a Pillow RGB image. Raises Retryable for damage or another size."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            # The header's size is checked before any pixel is decoded.
            if image.size != (width, height):
                size = "{} × {} instead of {} × {} px".format(*image.size, width, height)
                raise Retryable(f"screenshot_size: {size}")
            return image.convert("RGB")
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise Retryable(f"screenshot_damaged: {error}") from None


class PngWriter:
    """Writes a PNG from top to bottom; leaving the block completes the file.

    Pillow can only encode an image that is in memory as a whole.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        self._path, self._width, self._height, self._rows = path, width, height, 0
        self._compressor = zlib.compressobj(_COMPRESSION)
        self._last_row: Any = None

    def __enter__(self) -> Self:
        self._file = self._path.open("wb")
        self._file.write(b"\x89PNG\r\n\x1a\n")
        # Eight bits per channel, colour type 2 (RGB), not interlaced (PNG specification, 11.2.2).
        header = struct.pack(">IIBBBBB", self._width, self._height, 8, 2, 0, 0, 0)
        self._write_chunk(b"IHDR", header)
        return self

    def add_tile(self, image: Any) -> None:
        """Append a Pillow RGB image. Raises Retryable when its width differs."""
        from PIL import Image, ImageChops

        width, height = image.size
        if width != self._width:
            raise Retryable(f"screenshot_size: a tile of {width} in an image of {self._width} px")
        above = Image.new("RGB", image.size)
        above.paste(image, (0, 1))
        if self._last_row is not None:
            above.paste(self._last_row, (0, 0))
        differences = ImageChops.subtract_modulo(image, above).tobytes()
        # One byte with the filter's number precedes each row.
        rows = Image.new("L", (1 + 3 * width, height), _FILTER_UP)
        rows.paste(Image.frombuffer("L", (3 * width, height), differences), (1, 0))
        self._write_chunk(b"IDAT", self._compressor.compress(rows.tobytes()))
        self._last_row = image.crop((0, height - 1, width, height))
        self._rows += height

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        with self._file:
            if kind is None:
                if self._rows != self._height:
                    raise Retryable(f"screenshot_size: {self._rows} rows of {self._height}")
                self._write_chunk(b"IDAT", self._compressor.flush())
                self._write_chunk(b"IEND", b"")

    def _write_chunk(self, name: bytes, data: bytes) -> None:
        self._file.write(struct.pack(">I", len(data)) + name + data)
        self._file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
