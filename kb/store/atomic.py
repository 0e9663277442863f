"""Atomic writes: a file or folder is written under a temporary name, synced, then renamed."""

import contextlib
import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import DiskFull
from kb.store import process

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
FULL_HINT = "free some space and run the same command again"


@contextlib.contextmanager
def full_disk_is_resumable(path: Path) -> Iterator[None]:
    """Turn "no space left" into DiskFull (exit 3), whichever library met it."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL or any(
            f"[errno {number}]" in str(error).lower() for number in _FULL
        ):
            raise DiskFull(f"no space left to write {path}", hint=FULL_HINT) from error
        raise


@contextlib.contextmanager
def writing(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """A temporary path in the same folder; renamed to `path` when the block ends well.

    `sync=False` is for files in a fresh folder, which `replacing_folder` syncs before it counts.
    Raises DiskFull. Nothing is left behind when the block fails.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{process.mark()}-{uuid.uuid4().hex[:8]}.tmp")
    try:
        with full_disk_is_resumable(path):
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
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh, old = _fresh(path), _old(path)
    fresh.mkdir()
    try:
        with full_disk_is_resumable(path):
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


def followed(path: Path) -> Path:
    """Where a folder is: on another disk, say, with a link in its place."""
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
