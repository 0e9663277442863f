"""Captured pages and images, which are stored outside the raw log and have their own checksums.

    raw/wiki/images/<sha256>.<ending>   the name says what is in it
    raw/wiki/pages/<id>/<revision>/…    SHA256SUMS beside them says it, as for `sha256sum -c`

A reader that finds one changed notes it (kb.store.damage); the next crawl sets it aside as
`<name>.damaged` and fetches again what was in it.
"""

import os
import re
import shutil
from collections.abc import Callable, Collection
from hashlib import sha256
from pathlib import Path

from kb.core.errors import DamagedData
from kb.core.regular_file import read_regular
from kb.store.artifact_registry import SUMS
from kb.store.atomic import sync_folder, write_bytes
from kb.store.damage import note_damage, noted_damage, open_file, opening, unreadable
from kb.store.layout import BELOW, CAPTURED, Layout
from kb.store.tables.checksums import digest, listed, parsed
from kb.store.walk import files_below

QUARANTINE_SUFFIX = ".damaged"
CAPTURE = ("extraction.json.zst", "page.html.zst", "screenshot.png")
"""The files of a captured page, beside SHA256SUMS."""

_NAMED = re.compile(r"([0-9a-f]{64})\.[a-z0-9]+")


def is_captured_name(name: str) -> bool:
    """Whether a crawl gives this name to a captured page's file or an image."""
    return name in CAPTURE or name == SUMS or _NAMED.fullmatch(name) is not None


def write_sums(folder: Path) -> None:
    """Write SHA256SUMS over the files of a folder that is on its way."""
    files = sorted(path for path in folder.iterdir() if path.name != SUMS)
    (folder / SUMS).write_text(listed(files), encoding="utf-8")


def sums(folder: Path) -> dict[str, str]:
    """File name → digest as SHA256SUMS says, {} where there is none or it can't be read."""
    try:
        text = read_regular(folder / SUMS).decode()
    except (OSError, UnicodeDecodeError):
        return {}
    return parsed(text)[0]


def expected(path: Path) -> str | None:
    """The digest that a file should have, None where nothing says it."""
    named = _NAMED.fullmatch(path.name)
    return named[1] if named else sums(path.parent).get(path.name)


def is_intact(path: Path, advance: Callable[[int], None] | None = None) -> bool:
    """Whether a file is there and what it was, by what is `expected` of it."""
    if not path.is_file() or not path.stat().st_size:
        return False
    wanted = expected(path)
    return wanted is None or digest(path, advance=advance) == wanted


def write_named(path: Path, data: bytes) -> None:
    """Write a file that is named by its content, unless it is there with it. Raises DiskFull."""
    if not path.is_file() or path.stat().st_size != len(data) or path.read_bytes() != data:
        write_bytes(path, data)


def suspects(root: Path) -> list[str]:
    """The noted captured files that still are not what they should be, by path from the root."""
    at = Layout(root)
    noted = [path for top in (at.captures, at.images) for path in noted_damage(root, top)]
    return [str(path.relative_to(root)) for path in noted if not is_intact(path)]


def quarantine_file(path: Path) -> None:
    """Rename a damaged file so that no reader uses it."""
    if path.is_file():
        os.replace(path, quarantine_path(path))
        sync_folder(path.parent)


def quarantine_path(path: Path) -> Path:
    """The name that a damaged file gets."""
    return path.with_name(path.name + QUARANTINE_SUFFIX)


def lost(root: Path, source: str, paths: Collection[Path]) -> DamagedData:
    """What to raise for files that are missing or not what they were; notes them."""
    note_damage(root, paths)
    first = min(paths)
    what = "is not what was stored"
    if not first.is_file():
        what = "is not there"
    elif not first.stat().st_size:
        what = "is empty"
    more = f" (and {len(paths) - 1:,} more files)" if len(paths) > 1 else ""
    return DamagedData(
        f"{first} {what}{more}",
        hint=f"run `kb {source} crawl`, which fetches it again; then `kb {source} filter`",
        paths=[first],
    )


def is_captured_path(path: str) -> bool:
    """Whether a path, relative to a data root, names a place in raw/wiki. Folders on the way may be
    links.
    """
    return Path(path).is_relative_to(BELOW.raw(CAPTURED)) and ".." not in Path(path).parts


def captured_path(root: Path, path: str) -> Path:
    """The place of a captured page or image. Raises DamagedData for a path outside raw/wiki."""
    if not is_captured_path(path):
        raise DamagedData(
            f"a page or an image is {path!r}, which is not in {Layout(root).raw(CAPTURED)}",
            hint="those raw files are not from a crawl: move them away",
        )
    return root / path


def remove_image(root: Path, path: str) -> None:
    """Remove an image that a crawl stored, if it is there, what was set aside of it, and what a
    link in its place leads to.
    """
    place, raw = root / path, Layout(root).raw(CAPTURED).resolve()
    is_inside = place.resolve().is_relative_to(raw)
    if not is_captured_path(path) or not (is_inside or _NAMED.fullmatch(place.name)):
        return  # no crawl wrote it
    _remove(place)
    quarantine_path(place).unlink(missing_ok=True)


def remove_page(root: Path, key: str) -> None:
    """Remove the captures of a page, also where links lead to their folders on another disk."""
    page = Layout(root).captures / key
    captured = [
        path
        for path in files_below(page, strict=False)
        if is_captured_name(path.name.removesuffix(QUARANTINE_SUFFIX))
    ]
    for path in sorted(captured, key=lambda path: path.name == SUMS):  # which describes the others
        _remove(path)
    if page.is_symlink():
        page.unlink()
    else:
        shutil.rmtree(page, ignore_errors=True)


def _remove(path: Path) -> None:
    """Remove a captured file; of a link to one, both, but nobody else's file."""
    if path.is_symlink() and expected(path) is not None and is_intact(path):
        path.resolve().unlink()
    path.unlink(missing_ok=True)


def captured_file(root: Path, path: str) -> Path:
    """The place of a captured page or image, whose bytes are yet to be compared with what is
    `expected` of it. Raises DamagedData for a path outside raw/wiki, and where a link leads out of
    the data root to a file of which nothing is expected.
    """
    file = captured_path(root, path)
    if expected(file) is None and not file.resolve().is_relative_to(root.resolve()):
        raise unreadable(file, "it leads out of the data root, and no checksum describes it")
    return file


def read_captured(root: Path, path: str) -> bytes:
    """The bytes of a captured page or image. Raises DamagedData as `captured_file`, and for bytes
    that are not what was stored.
    """
    file = captured_file(root, path)
    with opening(file), open_file(file) as opened:
        data = opened.read()
    if expected(file) not in (None, sha256(data).hexdigest()):
        raise unreadable(file, "it is not what was stored")
    return data
