"""Writes a tall PNG piece by piece, so that memory holds one tile and never the image."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, Self

from kb.core.errors import Retryable

_LEVEL = 4  # screenshots are flat: more effort gains little


class PngWriter:
    """`add` RGB tiles of the full width from top to bottom; leaving the block closes the file.

    Raises Retryable when a tile has another width or the rows don't add up to the height.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        self._path, self._width, self._height, self._rows = path, width, height, 0
        self._pack = zlib.compressobj(_LEVEL)
        self._last: Any = None

    def __enter__(self) -> Self:
        self._file = self._path.open("wb")
        self._file.write(b"\x89PNG\r\n\x1a\n")
        # Eight bits a channel, colour type 2 (RGB), no interlace (PNG specification, 11.2.2).
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", self._width, self._height, 8, 2, 0, 0, 0))
        return self

    def add(self, tile: Any) -> None:
        """Append a Pillow RGB image, each row as its difference to the one above (filter Up)."""
        from PIL import Image, ImageChops

        width, height = tile.size
        if width != self._width or tile.mode != "RGB":
            raise Retryable(f"screenshot_size: a tile of {width} in an image of {self._width} px")
        above = Image.new("RGB", tile.size)
        above.paste(tile, (0, 1))
        if self._last is not None:
            above.paste(self._last, (0, 0))
        stride, data = width * 3, memoryview(ImageChops.subtract_modulo(tile, above).tobytes())
        for row in range(height):
            self._write(self._pack.compress(b"\x02" + data[row * stride : (row + 1) * stride]))
        self._last = tile.crop((0, height - 1, width, height))
        self._rows += height

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        try:
            if kind is None:
                if self._rows != self._height:
                    raise Retryable(f"screenshot_size: {self._rows} rows of {self._height}")
                self._write(self._pack.flush())
                self._chunk(b"IEND", b"")
        finally:
            self._file.close()

    def _write(self, data: bytes) -> None:
        if data:
            self._chunk(b"IDAT", data)

    def _chunk(self, name: bytes, data: bytes) -> None:
        self._file.write(
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )
