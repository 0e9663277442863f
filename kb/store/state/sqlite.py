"""Opens SQLite; errors name the file and say what to do.

no room           DiskFull: the same command goes on
not permitted     FatalError: permissions are no damage
busy              FatalError: another program holds it
the disk fails    FatalError
anything else     DamagedData: the file is moved away and made again
"""

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import DamagedData, FatalError
from kb.store.exhausted import as_disk_full, disk_full

REBUILT = "move it away; the next run rebuilds it from the raw data"
_FULL = {
    "SQLITE_FULL",
    "SQLITE_IOERR_WRITE",
    "SQLITE_IOERR_FSYNC",
    "SQLITE_IOERR_TRUNCATE",
    "SQLITE_IOERR_SHMSIZE",
}


def connect(path: Path, *, readonly: bool = False) -> sqlite3.Connection:
    """Open or make the file, for several threads under a lock of the caller's own."""
    if not readonly and not path.exists():
        # A log without its file belongs to one that was moved away: it would fill the new one.
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
    name = f"{path.absolute().as_uri()}?mode={'ro' if readonly else 'rwc'}"
    return sqlite3.connect(
        name, uri=True, check_same_thread=False, timeout=30, isolation_level=None
    )


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise errors of the file at `path` as KbError, as above."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        raise _as_kb_error(error, path) from error


def _as_kb_error(error: sqlite3.DatabaseError, path: Path) -> Exception:
    """The error of the file at `path` in a user's words; our own mistakes stay what they are."""
    name = getattr(error, "sqlite_errorname", "")
    if isinstance(error, (sqlite3.ProgrammingError, sqlite3.IntegrityError)):
        return error
    if name in _FULL:
        return disk_full(path)
    # Without inodes the file, or one beside it, can't be made.
    failed = name.startswith(("SQLITE_CANTOPEN", "SQLITE_IOERR")) and not _not_allowed(path)
    if failed and (full := as_disk_full(error, path)):
        return full
    if name.startswith(("SQLITE_BUSY", "SQLITE_LOCKED")):
        message = f"the state {path} can't be read: {error}"
        return FatalError(message, hint="another program uses it: try again in a moment")
    if name.startswith(("SQLITE_CANTOPEN", "SQLITE_READONLY", "SQLITE_PERM")):
        why = _not_allowed(path) or str(error)
        hint = "kb needs permission to read and write it and its folder"
        return FatalError(f"the state {path} can't be opened: {why}", hint=hint)
    if name.startswith("SQLITE_IOERR"):
        message = f"the state {path} can't be read: {error}"
        return FatalError(message, hint="check the disk, then run the same command again")
    return DamagedData(f"the state {path} can't be read: {error}", hint=REBUILT)


def _not_allowed(path: Path) -> str:
    if path.is_dir():
        return "it is a folder"
    if not os.access(path.parent, os.R_OK | os.W_OK | os.X_OK):
        return f"no permission in {path.parent}"
    return "" if not path.exists() or os.access(path, os.R_OK | os.W_OK) else "no permission"
