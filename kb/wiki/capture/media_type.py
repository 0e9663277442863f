"""Detects media type, size and frames of an image file by its bytes, never by its name.

Sizes come from headers. Only files within `max_pixels` are decoded further, for the frames of an
animation, as long as its frames have no more than MAX_PIXELS together. SVG is read as text; its
scripts never run.
"""

import io
import re
import warnings
from dataclasses import dataclass
from typing import Any

_MAGIC = (
    (b"\x89PNG\r\n\x1a\n", "image/png"),
    (b"\xff\xd8\xff", "image/jpeg"),
    (b"GIF87a", "image/gif"),
    (b"GIF89a", "image/gif"),
    (b"BM", "image/bmp"),
    (b"II*\x00", "image/tiff"),
    (b"MM\x00*", "image/tiff"),
    (b"\x00\x00\x01\x00", "image/vnd.microsoft.icon"),
)
_EXTENSION = {
    "image/png": "png",
    "image/jpeg": "jpg",
    "image/gif": "gif",
    "image/webp": "webp",
    "image/avif": "avif",
    "image/svg+xml": "svg",
    "image/bmp": "bmp",
    "image/tiff": "tif",
    "image/vnd.microsoft.icon": "ico",
}
MAX_FRAMES = 5000
MAX_PIXELS = 2_000_000_000  # of all frames together: seconds of decoding
_MAX_SIDE = 1 << 30  # px; a longer side is no size


@dataclass(frozen=True)
class ImageFile:
    """Sizes in px; `frames` are durations in ms, empty for a still image."""

    media_type: str
    width: int | None
    height: int | None
    frames: tuple[int | None, ...] = ()

    @property
    def extension(self) -> str:
        """The file name's ending for this media type."""
        return _EXTENSION[self.media_type]


def media_type(data: bytes) -> str | None:
    """The media type by the first bytes; None for anything but an image."""
    for magic, name in _MAGIC:
        if data.startswith(magic):
            return name
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "image/webp"
    if data[4:8] == b"ftyp" and data[8:12] in (b"avif", b"avis"):
        return "image/avif"
    text = data[:4096].lstrip(b"\xef\xbb\xbf").lstrip()
    if text.startswith(b"<") and re.search(rb"<svg[\s>]", text):
        return "image/svg+xml"
    return None


def inspect(data: bytes, max_pixels: int) -> ImageFile | None:
    """Inspect the bytes; None for anything but an image with an intact header."""
    kind = media_type(data)
    if kind is None:
        return None
    if kind == "image/svg+xml":
        return ImageFile(kind, *_svg_size(data[:4096]))
    from PIL import Image

    with warnings.catch_warnings():
        # Pillow warns about large sizes, of which nothing is decoded, and about odd metadata.
        warnings.simplefilter("ignore")
        try:
            with Image.open(io.BytesIO(data)) as image:
                width, height = image.size
                frames = _frames(image, width * height) if width * height <= max_pixels else ()
                return ImageFile(kind, width, height, frames)
        except Image.DecompressionBombError:
            return ImageFile(kind, *_header_size(kind, data))
        except MemoryError:
            raise
        except Exception:  # noqa: BLE001  Pillow's plugins raise anything for a broken file
            return None


def _frames(image: Any, pixels: int) -> tuple[int | None, ...]:
    """Durations of the frames of a GIF, APNG or WebP in ms; none for a still image, nor for one
    whose frames, of so many pixels each, are too many to be decoded.
    """
    count = getattr(image, "n_frames", 1)
    if count <= 1 or not getattr(image, "is_animated", False):
        return ()
    count = min(count, MAX_FRAMES)
    if count * pixels > MAX_PIXELS:
        return ()
    durations: list[int | None] = []
    for index in range(count):
        try:
            image.seek(index)
            duration = image.info.get("duration")
            durations.append(None if duration is None else _number(duration))
        except MemoryError:
            raise
        except Exception:  # noqa: BLE001  as above
            break  # truncated: count the frames that are present
    return tuple(durations)


def _number(value: float) -> int | None:
    """A whole number that a table holds; None for any other."""
    return round(value) if 0 <= value < _MAX_SIDE else None


def _header_size(kind: str, data: bytes) -> tuple[int | None, int | None]:
    """Sizes that Pillow refuses to open: PNG and GIF have them at a fixed offset."""
    if kind == "image/png":
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    if kind == "image/gif":
        return int.from_bytes(data[6:8], "little"), int.from_bytes(data[8:10], "little")
    return None, None


def _svg_size(data: bytes) -> tuple[int | None, int | None]:
    """Width and height of the svg element where they are plain numbers of pixels."""
    head = re.search(rb"<svg\b[^>]*>", data)
    sides = [
        re.search(
            rb"\s" + name + rb"""\s*=\s*["']\s*(\d{1,20}(?:\.\d{1,20})?)(?:px)?\s*["']""", head[0]
        )
        if head
        else None
        for name in (b"width", b"height")
    ]
    width, height = (_number(float(match[1])) if match else None for match in sides)
    return width, height
