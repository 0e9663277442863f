"""Tells a full disk and memory that ran out from any other failure, and says what is free.

Each is one fact with many errors. Of a full disk Python, Arrow and PyAV tell with an errno, SQLite
with codes of its own; NumPy, tantivy, torch, tokenizers and DuckDB say only that something failed,
each in its own class and words. Where no errno says what happened, the file system is asked whether
it still takes a file. Of memory Python and Arrow's pools tell with MemoryError, the system with an
errno, DuckDB and torch with a class of their own; what has only words for it is any other failure,
with its own message.
"""

import contextlib
import errno
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import DiskFull, KbError, Stopped

FULL_HINT = "free some space and run the same command again"
LIMIT_HINT = "raise it (ulimit -f) and run the same command again"
_WHY = {
    errno.ENOSPC: "",
    errno.EDQUOT: " (the quota is used up)",
    errno.EFBIG: " (the limit for the size of a file is reached)",
}
# Bytes: a library may have removed a part of what it wrote before it reports the failure.
_LEAST_ROOM = 64 << 20
HINT = "try fewer --workers"
_MEMORY = (("duckdb", "OutOfMemoryException"), ("torch", "OutOfMemoryError"))


def is_out_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or the one that led to it, means that memory ran out."""
    named = (getattr(sys.modules.get(module), name, None) for module, name in _MEMORY)
    kinds = (MemoryError, *filter(None, named))
    while error is not None:
        if isinstance(error, kinds):
            return True
        if isinstance(error, OSError) and error.errno in (errno.ENOMEM, errno.EAGAIN):
            return True
        error = error.__cause__
    return False


@contextlib.contextmanager
def full_disk_is_resumable(*places: Path) -> Iterator[None]:
    """Turn "no space left" into DiskFull (exit 4), whichever library met it.

    `places` are the files or folders that the block writes; the one that is full is named. Use it
    around what writes, inside of what cleans up: afterwards there may be room again.
    """
    try:
        yield
    except BaseException as error:
        if full := as_disk_full(error, *places):
            raise full from error
        raise


def as_disk_full(error: BaseException, *places: Path) -> DiskFull | None:
    """The DiskFull that an error stands for; None for one with another cause."""
    # pyo3 makes a PanicException of a panic: it is no Exception, and its class can't be imported.
    failed = isinstance(error, Exception) or type(error).__name__ == "PanicException"
    if isinstance(error, Stopped) or not failed:
        return None
    cause = _system_error(error)
    if cause is None:
        # An error of Lorecrawl says what it means, and so does an errno; others may be a full disk.
        clear = isinstance(error, KbError) or type(error).__module__[:3] == "kb."
        clear = clear or is_out_of_memory(error)
        clear = clear or (isinstance(error, OSError) and error.errno is not None)
        full = None if clear else next(filter(_without_room, places), None)
        return disk_full(full) if full else None
    # A block that writes one thing has a better name for it than that of a temporary file.
    named = [] if len(places) == 1 else [*_named(cause)]
    written = (*named, *places) or (Path(),)
    on_one = len({_folder(path).stat().st_dev for path in (*written, *_named(cause))}) == 1
    full = None if on_one else next(filter(_without_room, (*written, *_named(cause))), written[-1])
    return disk_full(full or written[0], cause.errno or errno.ENOSPC)


def disk_full(path: Path, number: int | None = None) -> DiskFull:
    """The error for a file or folder that could not be written, by the errno if it is known. Call
    it before anything is removed: it says what is free.
    """
    number = number or _without_room(path) or errno.ENOSPC
    folder = _folder(path)
    free, files = shutil.disk_usage(folder).free, os.statvfs(folder)
    more = " and no more files" if files.f_files and not files.f_favail else ""
    what = f"no space left to write {path}{_WHY[number]}: {folder} has"
    hint = LIMIT_HINT if number == errno.EFBIG else FULL_HINT
    return DiskFull(f"{what} {free / 1e6:,.1f} MB{more} free", hint=hint)


def _system_error(error: BaseException | None) -> OSError | None:
    """The system's error that is behind this one, if it is about room."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _WHY:
            return error
        error = error.__cause__ or error.__context__
    return None


def _named(error: OSError | None) -> Iterator[Path]:
    """The file that an error of the system is about, where it says so."""
    if error is not None and isinstance(error.filename, str | bytes):
        yield Path(os.fsdecode(error.filename))


def _without_room(path: Path) -> int | None:
    """Why the file system has no room for another file, as an errno: a full disk, also without
    inodes, a quota, or the limit of a file's size; None where it has.
    """
    left = _LEAST_ROOM
    try:
        with tempfile.TemporaryFile(dir=_folder(path), buffering=0) as file:
            while left:  # the part that still fits is written first
                left -= file.write(bytes(left)) or 0
    except OSError as error:
        return error.errno if error.errno in _WHY else None
    return None


def _folder(path: Path) -> Path:
    """The nearest folder there is."""
    path = path.absolute()
    return next((folder for folder in (path, *path.parents) if folder.is_dir()), Path("/"))
