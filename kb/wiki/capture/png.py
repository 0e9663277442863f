"""PNG rows as a browser packed them: read, looked at in part, and joined to one tall image.

A row is kept as its difference to the row above (PNG's filter Up) behind the filter's number. So
the browser's rows go on into the tall image as they are, and pixels, which are the sum of all
differences up to them, are made of the few places only that are compared or cropped.
"""

from __future__ import annotations

import functools
import io
import struct
import zlib
from pathlib import Path
from typing import Any, Self

from kb.core.errors import Retryable

_LEVEL = 4  # screenshots are flat: more effort gains little
_UP = b"\x02"
_BAND = 256  # rows; where pixels are asked for, at most so many are summed in vain
_RUN = 32  # rows that are like the one above are packed by so many
_CHUNK = 1 << 16  # bytes; always cut alike, so that the same pixels give the same bytes

Box = tuple[int, int, int, int]


class PixelRows:
    """Rows of RGB pixels: `packed` has 1 + 3 × `width` bytes a row, the first against black."""

    def __init__(self, packed: bytes, width: int) -> None:
        self.packed, self.width = packed, width
        self.height = len(packed) // (1 + 3 * width)
        self._field = _grey(packed, 1 + 3 * width)
        self._above = [_black(1 + 3 * width)]  # the pixels above each band
        for top in range(0, self.height, _BAND):
            self._above.append(_sum(self._above[-1], self._crop(0, top, 1 + 3 * width, _BAND)))

    @classmethod
    def of(cls, image: Any) -> Self:
        """The rows of a Pillow RGB image."""
        from PIL import Image, ImageChops

        width, height = image.size
        above = Image.new("RGB", image.size)
        above.paste(image, (0, 1))
        bare = ImageChops.subtract_modulo(image, above).tobytes()
        packed = Image.new("L", (1 + 3 * width, height), _UP[0])
        packed.paste(_grey(bare, 3 * width), (1, 0))
        return cls(packed.tobytes(), width)

    @classmethod
    def read(cls, data: bytes, width: int, height: int) -> Self:
        """The rows of a PNG of that size. Raises Retryable when it has another one or is none."""
        from PIL import Image

        if len(data) < 29 or data[12:16] != b"IHDR":
            raise Retryable("screenshot_damaged: it is no PNG")
        found = struct.unpack(">IIBBBBB", data[16:29])
        # The size is checked in the header before anything is unpacked.
        if found[:2] != (width, height):
            raise Retryable(
                f"screenshot_size: {found[0]} × {found[1]} instead of {width} × {height} px"
            )
        try:
            if found[2:] == (8, 2, 0, 0, 0):  # eight bits a channel, RGB, no interlace
                packed = _unpacked(data, (1 + 3 * width) * height)
                if packed[:: 1 + 3 * width] == _UP * height:
                    return cls(packed, width)
            with Image.open(io.BytesIO(data)) as image:
                return cls.of(image.convert("RGB"))
        except (OSError, SyntaxError, zlib.error) as error:  # the first two are Pillow's
            raise Retryable(f"screenshot_damaged: {error}") from None

    def part(self, box: Box) -> Any:
        """A Pillow RGB image of (left, top, right, bottom); black beyond the sides."""
        from PIL import Image, ImageChops

        left, top, right, bottom = box
        inner = max(left, 0), min(right, self.width)
        if inner[0] >= inner[1]:
            return Image.new("RGB", (right - left, bottom - top))
        first, columns = top // _BAND, (1 + 3 * inner[0], 1 + 3 * inner[1])
        above = self._above[first].crop((columns[0], 0, columns[1], 1))
        rows = self._crop(columns[0], first * _BAND, columns[1], bottom - first * _BAND)
        start = Image.new("L", rows.size)
        start.paste(above, (0, 0))
        rows, by = ImageChops.add_modulo(rows, start), 1
        while by < rows.height:  # the sums of 2 rows, of 4, of 8 …
            rows = ImageChops.add_modulo(rows, rows.crop((0, -by, rows.width, rows.height - by)))
            by *= 2
        bare = rows.crop((0, top - first * _BAND, rows.width, rows.height)).tobytes()
        size = inner[1] - inner[0], bottom - top
        image = Image.frombuffer("RGB", size, bare, "raw", "RGB", 0, 1)
        return image.crop((left - inner[0], 0, right - inner[0], bottom - top))

    def _crop(self, left: int, top: int, right: int, rows: int) -> Any:
        return self._field.crop((left, top, right, min(top + rows, self.height)))


def _unpacked(data: bytes, size: int) -> bytes:
    """The content of a PNG's IDAT chunks, so many bytes. Raises OSError or zlib.error."""
    parts, at = [], 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if data[at + 4 : at + 8] == b"IDAT":
            parts.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    unpack = zlib.decompressobj()
    found = unpack.decompress(b"".join(parts), size)
    more = unpack.decompress(unpack.unconsumed_tail, 1)
    if len(found) != size or more or not unpack.eof:
        raise OSError("it does not have the rows that it names")
    return found


def _grey(data: bytes, width: int) -> Any:
    """Bytes as a grey Pillow image of so many columns, without a copy."""
    from PIL import Image

    return Image.frombuffer("L", (width, len(data) // width), data, "raw", "L", 0, 1)


def _black(width: int) -> Any:
    from PIL import Image

    return Image.new("L", (width, 1))


def _sum(above: Any, rows: Any) -> Any:
    """One row: `above` and all rows of a grey image, added modulo 256."""
    from PIL import ImageChops

    while rows.height > 1:
        half = (rows.height + 1) // 2
        # What a crop takes from beyond the edge is zero.
        lower = rows.crop((0, half, rows.width, 2 * half))
        rows = ImageChops.add_modulo(rows.crop((0, 0, rows.width, half)), lower)
    return ImageChops.add_modulo(above, rows)


class PngWriter:
    """`add` rows of the full width from top to bottom; leaving the block closes the file.

    Raises Retryable when rows have another width or don't add up to the height.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        self._path, self._width, self._height, self._rows = path, width, height, 0
        self._pack, self._sum = _packer(), 1
        self._packed = bytearray(b"\x78\x5e")  # zlib's head: a window of 32 KiB, quick
        self._same = _UP + bytes(3 * width)  # a row that is like the one above
        self._run = 0  # of such rows, which were not packed yet
        self._last: Any = None

    def __enter__(self) -> Self:
        self._file = self._path.open("wb")
        self._file.write(b"\x89PNG\r\n\x1a\n")
        # Eight bits a channel, colour type 2 (RGB), no interlace (PNG specification, 11.2.2).
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", self._width, self._height, 8, 2, 0, 0, 0))
        return self

    def add(self, rows: PixelRows, count: int) -> None:
        """Append the first `count` rows."""
        from PIL import ImageChops

        width = rows.width
        if width != self._width:
            raise Retryable(f"screenshot_size: a tile of {width} in an image of {self._width} px")
        end = count * len(self._same)
        if self._last is None:
            self._take(rows.packed, 0, end)
        else:
            first = ImageChops.subtract_modulo(rows.part((0, 0, width, 1)), self._last)
            self._take(_UP + first.tobytes(), 0, len(self._same))
            self._take(rows.packed, len(self._same), end)
        self._last = rows.part((0, count - 1, width, count))
        self._rows += count
        self._write(_CHUNK)

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        try:
            if kind is None:
                if self._rows != self._height:
                    raise Retryable(f"screenshot_size: {self._rows} rows of {self._height}")
                self._end_run()
                self._packed += self._pack.flush() + struct.pack(">I", self._sum)
                self._write(1)
                self._chunk(b"IEND", b"")
        finally:
            self._file.close()

    def _take(self, rows: bytes, at: int, end: int) -> None:
        """Pack bytes of whole rows. Those that are like the one above wait for the run's end."""
        self._sum = zlib.adler32(memoryview(rows)[at:end], self._sum)
        stride, same = len(self._same), self._same
        while at < end:
            begin = at
            while at < end and rows.startswith(same, at):
                at += stride
            self._run += (at - begin) // stride
            if at == end:
                return
            self._end_run()
            begin = at
            while at < end and not rows.startswith(same, at):
                at += stride
            self._packed += self._pack.compress(memoryview(rows)[begin:at])

    def _end_run(self) -> None:
        blocks, rest = divmod(self._run, _RUN)
        if blocks:
            # To search such rows for repeats takes longest, and a page has many. They are packed
            # once; a full flush on both sides keeps other rows from pointing across.
            self._packed += self._pack.flush(zlib.Z_FULL_FLUSH)
            self._packed += _run(self._width) * blocks
        self._packed += self._pack.compress(self._same * rest)
        self._run = 0

    def _write(self, least: int) -> None:
        """Write what is packed while it is at least so many bytes."""
        while len(self._packed) >= least:
            self._chunk(b"IDAT", bytes(self._packed[:_CHUNK]))
            del self._packed[:_CHUNK]

    def _chunk(self, name: bytes, data: bytes) -> None:
        self._file.write(struct.pack(">I", len(data)) + name + data)
        self._file.write(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))


def _packer() -> Any:
    """A packer without zlib's head and sum, whose parts can be put behind each other."""
    return zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)


@functools.lru_cache(maxsize=64)
def _run(width: int) -> bytes:
    """That many rows like the one above, packed by themselves."""
    pack = _packer()
    return b"".join([pack.compress((_UP + bytes(3 * width)) * _RUN), pack.flush(zlib.Z_FULL_FLUSH)])
