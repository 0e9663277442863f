"""Screenshots from a release's tars or a data root, and boxes drawn on them. Needs Pillow."""

from __future__ import annotations

import hashlib
import io
import json
import struct
import tarfile
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

from kb.core.errors import DamagedData
from kb.reader.tables import needs
from kb.store.damage import DOWNLOAD, missing, opening, short_lines, unreadable
from kb.store.rawlog.sidefiles import captured_path
from kb.store.tables.remote_files import RemoteFolder, reading_at

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

INDEX = "index.ndjson"
COLOURS = {
    "text": "#0072b2",
    "image": "#d55e00",
    "sprite": "#cc79a7",
    "animation": "#e69f00",
    "table": "#009e73",
    "cell": "#56b4e9",
    "video": "#000000",
    "audio": "#000000",
}
_LINE = 2  # CSS px
_PIXELS = 400_000_000  # of a screenshot: 100,000 px of height, and twice the usual width
_BYTES = 200_000_000  # of a screenshot's file
_PNG = b"\x89PNG\r\n\x1a\n"


class TextLine(NamedTuple):
    """The box of one line of a text, in CSS pixels of the page."""

    x: float
    y: float
    width: float
    height: float


class Box(NamedTuple):
    """An element's box in CSS pixels of the page.

    `lines`: the boxes of a visible text's lines, from the top; None for other elements. Unlike the
    text's own box they don't cover what floats next to the text.
    """

    element_id: int
    kind: str
    tag: str
    region: str
    text: str | None
    x: float
    y: float
    width: float
    height: float
    lines: tuple[TextLine, ...] | None = None

    @property
    def parts(self) -> Sequence[Box | TextLine]:
        """What to draw: the lines if there are any, else the box itself."""
        return self.lines or (self,)


def box(row: dict[str, Any]) -> Box:
    """The box of a row of wiki_elements."""
    lines = row["lines"]
    given = {name: row[name] for name in Box._fields if name != "lines"}
    return Box(**given, lines=lines and tuple(TextLine(**line) for line in lines))


def screenshot(home: Path | RemoteFolder, row: dict[str, Any]) -> Picture:
    """The screenshot of a page's row. Raises MissingExtra and DamagedData.

    Pillow's limit on pixels is lifted only for an image of exactly the size in the page's row, and
    of no more pixels than a page can have.
    """
    needs("PIL", install="pillow")
    from PIL import Image

    data, where = stored_png(home, row["screenshot_path"])
    scale = row["device_pixel_ratio"]
    wanted = [round(row["page_width"] * scale), round(row["page_height"] * scale)]
    # Width and height of a PNG are in its header.
    is_png = len(data) >= 24 and data.startswith(_PNG)
    size = struct.unpack(">II", data[16:24]) if is_png else None
    if (
        size is None
        or size[0] * size[1] > _PIXELS
        or any(abs(one - other) > 2 * scale for one, other in zip(size, wanted, strict=True))
    ):
        raise DamagedData(f"{where} is not a PNG of {wanted[0]} × {wanted[1]} px", hint=DOWNLOAD)
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with opening(where, SyntaxError, ValueError, hint=DOWNLOAD):
            opened = Image.open(io.BytesIO(data), formats=["PNG"])
            opened.load()
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    return opened


def outlined(image: Picture, boxes: Iterable[Box], scale: float) -> Picture:
    """A copy with an outline for each box, or for each line of a text, clipped to the image."""
    needs("PIL", install="pillow")
    from PIL import ImageDraw

    copy = image.convert("RGB")
    pen = ImageDraw.Draw(copy)
    width = max(1, round(_LINE * scale))
    for kind, one in ((each.kind, part) for each in boxes for part in each.parts):
        left, top = round(one.x * scale), round(one.y * scale)
        right = max(left, round((one.x + one.width) * scale) - 1)
        bottom = max(top, round((one.y + one.height) * scale) - 1)
        pen.rectangle((left, top, right, bottom), outline=COLOURS[kind], width=width)
    return copy


def stored_png(home: Path | RemoteFolder, path: str) -> tuple[bytes, str]:
    """A screenshot's bytes, and where they are: `<tar>/<member>` of a release, or a data root's
    file. Raises DamagedData.
    """
    tar, slash, member = path.partition("/")
    if isinstance(home, RemoteFolder):
        return _remote_member(home, tar, member), f"{home}/{tar}: {member}"
    if slash and tar.endswith(".tar") and "/" not in member:
        return _member(home / tar, member), f"{home / tar}: {member}"
    file = captured_path(home, path)
    with opening(file):
        return file.read_bytes(), str(file)


def _member(tar: Path, member: str) -> bytes:
    if not tar.is_file():
        raise missing([tar], "download it into the folder of the tables")
    index = tar.parent / INDEX
    entries = _read(index, index.stat().st_mtime_ns) if index.is_file() else {}
    entry = entries.get((tar.name, member))
    if entry is None:
        return _searched(tar, member)
    with tar.open("rb") as file:
        return _verified(file, entry, str(tar))


def _remote_member(folder: RemoteFolder, tar: str, member: str) -> bytes:
    entry = _remote_index(folder).get((tar, member))
    if entry is None or tar not in folder.sizes:
        raise DamagedData(f"{folder} has no {tar}/{member}", hint="publish the release again")
    with folder.open(tar) as file, reading_at(f"{folder}/{tar}"):
        return _verified(file, entry, f"{folder}/{tar}")


def _verified(file: BinaryIO, entry: dict[str, Any], tar: str) -> bytes:
    file.seek(entry["offset"])
    data = file.read(entry["size"])
    if hashlib.sha256(data).hexdigest() != entry["sha256"]:
        member = entry["member"]
        raise DamagedData(f"{tar} is damaged: checksum mismatch of {member}", hint=DOWNLOAD)
    return data


def _searched(tar: Path, member: str) -> bytes:
    """A member found without an index, by reading the tar from its start."""
    try:
        with tarfile.open(tar, "r:") as opened:
            entry = opened.getmember(member)
            file = opened.extractfile(entry) if entry.isreg() and entry.size <= _BYTES else None
            if file is not None:
                return file.read()
    except (tarfile.TarError, KeyError, OSError, ValueError, RecursionError) as error:
        raise DamagedData(f"{tar} has no {member}: {error}", hint=DOWNLOAD) from None
    raise DamagedData(f"{tar} has no {member}", hint=DOWNLOAD)


@lru_cache(maxsize=4)
def _read(path: Path, changed: int) -> dict[tuple[str, str], dict[str, Any]]:
    return _entries(short_lines(path, DOWNLOAD), str(path))


@lru_cache(maxsize=4)
def _remote_index(folder: RemoteFolder) -> dict[tuple[str, str], dict[str, Any]]:
    return _entries(folder.read(INDEX).splitlines(), f"{folder}/{INDEX}")


def _entries(lines: Iterable[bytes], place: str) -> dict[tuple[str, str], dict[str, Any]]:
    members = {}
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            members[entry["tar"], entry["member"]] = entry
            valid = isinstance(entry["sha256"], str) and all(
                type(entry[name]) is int and 0 <= entry[name] <= most
                for name, most in (("offset", 1 << 62), ("size", _BYTES))
            )
            if not valid:
                raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise unreadable(place, f"line {number} is not an entry", DOWNLOAD) from None
    return members
