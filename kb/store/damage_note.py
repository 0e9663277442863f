"""Files of a data root that a command found damaged, a path a line in state/damaged-files.txt.

A reader notes them, without any lock; a crawl sets noted raw data aside and asks again, a build
makes noted artifacts again.
"""

import fcntl
from collections.abc import Iterable
from pathlib import Path

from kb.store.atomic import append
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout


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


def paths(root: Path, below: Path) -> list[Path]:
    """The noted files at or below a folder of the data root, by name."""
    return sorted(root / line for line in set(_lines(root)) if _is_below(root, line, [below]))


def forget(root: Path, *below: Path) -> None:
    """What was noted at or below these was made again, or is to be asked for again."""
    if not any(_is_below(root, line, below) for line in _lines(root)):
        return
    with Layout(root).damaged_files.open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        left = [line for line in _lines(root) if not _is_below(root, line, below)]
        file.truncate(0)
        file.write("".join(f"{line}\n" for line in left).encode())


def _lines(root: Path) -> list[str]:
    try:
        text = Layout(root).damaged_files.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return []
    return text.splitlines()


def _is_below(root: Path, line: str, folders: Iterable[Path]) -> bool:
    return ".." not in line and any(map((root / line).is_relative_to, folders))
