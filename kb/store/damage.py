"""The one error of files that are missing, damaged or foreign. It is raised where a file is opened,
and its hint is that of the artifact that the file belongs to; no command explains it again.

with opening(path, ValueError):         # what a library says of a broken file becomes DamagedData
    return json.loads(path.read_bytes())

A reader notes the files of a data root that it found damaged, without any lock, a path a line in
state/damaged-files.txt; a crawl sets noted raw data aside and asks again, a build makes noted
artifacts again.
"""

import contextlib
import fcntl
from collections.abc import Iterable, Iterator, Sequence
from io import BufferedReader
from pathlib import Path
from typing import Any, TypeVar, overload

import msgspec

from kb.core.errors import DamagedData
from kb.core.regular_file import NotRegular, open_regular, read_regular
from kb.store.artifact_registry import SUMS, artifact_of
from kb.store.atomic import append
from kb.store.exhausted import full_disk_is_resumable, is_out_of_memory
from kb.store.layout import Layout

DOWNLOAD = "download it again, into the same folder"
SMALL = 50_000_000  # bytes of a file that is read as a whole: checksums, tombstones, metadata


def remedy(path: Path) -> str:
    """How to get a damaged or missing file again: of a data root, else of a download."""
    if path.name == "tombstones.parquet":
        return "restore it from a copy: without it, purged content would return"
    match, is_released = artifact_of(path), (path.parent / SUMS).is_file()
    # A download is often named like the folder that it was released from, or like a data root's.
    of_root = match is not None and Layout(match[0]).state_folder().is_dir()
    if match is not None and (of_root or not (match[1].public or is_released)):
        return match[1].hint
    return DOWNLOAD if is_released else "restore it from a copy"


def unreadable(path: object, why: Exception | str, hint: str = "") -> DamagedData:
    """The error of a file that can't be read; `why` is a phrase, or what a library raised.

    `path` may be an address; then it needs a `hint`.
    """
    if isinstance(why, Exception):
        lines = (getattr(why, "strerror", None) or str(why)).splitlines()
        why = lines[0].rstrip(".") if lines else type(why).__name__
    paths = [path] if isinstance(path, Path) else []
    hint = hint or remedy(Path(str(path)))
    return DamagedData(f"{path} can't be read: {why}", hint=hint, paths=paths)


def missing(paths: Sequence[object], hint: str = "") -> DamagedData:
    """The error of files that were written and are not there; `paths` as in `unreadable`."""
    more = f" (and {len(paths) - 1:,} more files)" if len(paths) > 1 else ""
    files = [path for path in paths if isinstance(path, Path)]
    hint = hint or remedy(Path(str(paths[0])))
    return DamagedData(f"{paths[0]} is missing{more}", hint=hint, paths=files)


@contextlib.contextmanager
def opening(path: object, *kinds: type[Exception], hint: str = "") -> Iterator[None]:
    """Raises DamagedData where a block that reads a file raises OSError or one of these. That
    memory runs out is no damage.
    """
    try:
        yield
    except Exception as error:
        if not isinstance(error, (OSError, *kinds)) or is_out_of_memory(error):
            raise
        raise unreadable(path, error, hint) from error


def open_file(path: Path, hint: str = "") -> BufferedReader:
    """A file of a data root, open for reading. Raises DamagedData for what is no regular file or a
    link to one, OSError where nothing is.
    """
    try:
        return open_regular(path)
    except NotRegular as error:
        raise unreadable(path, error, hint) from None


def note_damage(root: Path, damaged: Iterable[Path]) -> None:
    """Note files that are missing or not what they were. Raises DiskFull, with none noted.

    Those outside of the data root, and all where it has no state, are left out.
    """
    place, top = Layout(root).damaged_files, root.absolute()
    files = [path.absolute() for path in damaged]
    lines = [f"{path.relative_to(top)}\n" for path in files if path.is_relative_to(top)]
    if not lines or not place.parent.is_dir():
        return
    with full_disk_is_resumable(place), place.open("ab", buffering=0) as file:
        # Several processes may do so at a time, and each has to know where its lines begin.
        fcntl.flock(file, fcntl.LOCK_EX)
        append(file, "".join(lines).encode())


def noted_damage(root: Path, below: Path) -> list[Path]:
    """The noted files at or below a folder of the data root, by name."""
    return sorted(root / line for line in set(_noted_lines(root)) if _is_below(root, line, [below]))


def forget_damage(root: Path, *below: Path) -> None:
    """What was noted at or below these was made again, or is to be asked for again."""
    if not any(_is_below(root, line, below) for line in _noted_lines(root)):
        return
    with Layout(root).damaged_files.open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        left = [line for line in _noted_lines(root) if not _is_below(root, line, below)]
        file.truncate(0)
        file.write("".join(f"{line}\n" for line in left).encode())


def _noted_lines(root: Path) -> list[str]:
    try:
        text = Layout(root).damaged_files.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return []
    return text.splitlines()


def _is_below(root: Path, line: str, folders: Iterable[Path]) -> bool:
    return ".." not in line and any(map((root / line).is_relative_to, folders))


Note = TypeVar("Note")


@overload
def read_note(path: Path, kind: type[Note], *, fix: str = "") -> Note | None: ...
@overload
def read_note(path: Path, kind: Any, *, fix: str = "") -> Any: ...
def read_note(path: Path, kind: Any, *, fix: str = "") -> Any:
    """The note, None where there is none.

    Raises DamagedData for a note that can't be read; `fix`: what to do, where that is not what
    the artifact's own hint says.
    """
    try:
        return msgspec.json.decode(read_regular(path), type=kind)
    except FileNotFoundError:
        return None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, NotRegular) as error:
        raise unreadable(path, error, fix) from None
