"""Atomic writes: a file or folder is written under a temporary name, synced, then renamed."""

import contextlib
import errno
import os
import re
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from kb.store.exhausted import full_disk_is_resumable

_MARK = re.compile(r"(\d+)-(\d+)")


def mark() -> str:
    """This process for good: its number, and when it began, as numbers are given again."""
    stat = _stat("self")
    return f"{stat[0]}-{stat[1]}" if stat is not None else "0-0"


def has_ended(text: str) -> bool:
    """Whether the process that a mark within `text` names has ended; False without a mark."""
    match = _MARK.search(text)
    if match is None or match[1] == "0":
        return False
    stat = _stat(match[1])
    return stat is None or stat[1] != int(match[2])


def _stat(process: str) -> tuple[int, int] | None:
    """Number and start (ticks since the machine was booted) of a process of this machine."""
    try:
        text = Path("/proc", process, "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    # The second field is a name in brackets, which may hold anything; the start is the 22nd.
    fields = text.rpartition(")")[2].split()
    return int(text.split(" ", 1)[0]), int(fields[19])


@contextlib.contextmanager
def writing(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """A temporary path in the same folder; renamed to `path` when the block ends well.

    `sync=False` is for files in a fresh folder, which `replacing_folder` syncs before it counts.
    Raises DiskFull. Nothing is left behind when the block fails.
    """
    temporary = path.with_name(f".{path.name}.{mark()}-{uuid.uuid4().hex[:8]}.tmp")
    try:
        with full_disk_is_resumable(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            if sync:
                sync_file(temporary)
            os.replace(temporary, path)
            if sync:
                sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Write a whole file. Raises DiskFull."""
    with writing(path) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)


def append(file: IO[bytes], data: bytes) -> int:
    """Write all of `data` to the end of an unbuffered file and sync it; the offset behind it.

    What could only be written in part is cut away again. Raises OSError.
    """
    start = file.seek(0, os.SEEK_END)
    left = memoryview(data)
    try:
        while left:
            # On a disk that fills up it takes what there is room for, and says how much.
            written = file.write(left)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            left = left[written:]
        os.fsync(file.fileno())
    except BaseException:
        file.truncate(start)
        os.fsync(file.fileno())
        raise
    return start + len(data)


def write_text(path: Path, text: str) -> None:
    """Write a whole UTF-8 file. Raises DiskFull."""
    write_bytes(path, text.encode())


@contextlib.contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A fresh temporary folder that takes the place of `path` when the block ends well.

    A crash between the two renames leaves the old folder as `.NAME.old`, which `settle_folder`
    (called here first) puts back or clears away. A link to a folder stays; what it leads to is
    replaced.
    """
    path = followed(path)
    settle_folder(path)
    fresh, old = _fresh(path), _old(path)
    try:
        with full_disk_is_resumable(path):
            fresh.mkdir(parents=True)
            yield fresh
            # A worker that was killed leaves what it was writing; its task was done again by
            # another.
            for left in fresh.rglob(".*.tmp"):
                left.unlink(missing_ok=True)
            for folder, _, names in os.walk(fresh):
                for name in names:
                    sync_file(Path(folder, name))
                sync_folder(Path(folder))
            if path.exists():
                os.rename(path, old)
            os.rename(fresh, path)
            sync_folder(path.parent)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    shutil.rmtree(old, ignore_errors=True)


def settle_folder(path: Path) -> None:
    """Finish or undo a `replacing_folder` that was cut off."""
    path = followed(path)
    old = _old(path)
    if os.path.lexists(old):
        if not path.exists():
            os.rename(old, path)
        elif old.is_symlink():
            old.unlink()
        else:
            shutil.rmtree(old)
    shutil.rmtree(_fresh(path), ignore_errors=True)


def remove_path(path: Path) -> None:
    """Remove a file or folder at once: it goes under a hidden name first, which the next command
    clears away if this one is killed. A link to a folder stays, and leads to nothing.
    """
    path = followed(path)
    moved = path.with_name(f".{path.name}.gone")
    for _ in range(2):  # what a killed removal left, then `path` itself
        if moved.is_dir() and not moved.is_symlink():
            shutil.rmtree(moved)
        else:
            moved.unlink(missing_ok=True)
        if os.path.lexists(path):
            os.rename(path, moved)
            sync_folder(path.parent)


def followed(path: Path) -> Path:
    """Where a folder or file is: on another disk, say, with a link in its place."""
    return path.resolve() if path.is_symlink() else path


def _fresh(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def _old(path: Path) -> Path:
    return path.with_name(f".{path.name}.old")


def sync_file(path: Path) -> None:
    """Ask the disk to keep what was written."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


sync_folder = sync_file
