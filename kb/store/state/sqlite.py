"""A connection to SQLite whose errors name the file and say what to do.

no room           DiskFull: the same command goes on
may not           FatalError: permissions are no damage
busy              FatalError: another program holds it
the disk fails    FatalError
anything else     DamagedData: the file is moved away and made again
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from kb.core.errors import DamagedData, DiskFull, FatalError
from kb.store.atomic import FULL_HINT, SQLITE_FULL

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

REBUILT = "move it away; the next run rebuilds it from the raw data"


def connect(path: Path, *, readonly: bool = False) -> Connection:
    """Open or make the file, for several threads under a lock of the caller's own. Raises KbError
    as above, also from every later call.
    """
    if not readonly and not path.exists():
        # A log without its file belongs to one that was moved away: it would fill the new one.
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
    name = f"{path.absolute().as_uri()}?mode={'ro' if readonly else 'rwc'}"
    try:
        made = sqlite3.connect(
            name,
            uri=True,
            check_same_thread=False,
            timeout=30,
            isolation_level=None,
            factory=Connection,
        )
    except sqlite3.DatabaseError as error:
        raise as_kb_error(error, path) from error
    made.file = path
    return made


def as_kb_error(error: sqlite3.DatabaseError, path: Path) -> Exception:
    """The error of the file at `path` in a user's words; our own mistakes stay what they are."""
    name = getattr(error, "sqlite_errorname", "")
    if isinstance(error, (sqlite3.ProgrammingError, sqlite3.IntegrityError)):
        return error
    if name in SQLITE_FULL:
        return DiskFull(f"no space left to write {path}", hint=FULL_HINT)
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


def _telling(call: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    def checked(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
        try:
            return call(*arguments, **options)
        except sqlite3.DatabaseError as error:
            at: Any = arguments[0]
            raise as_kb_error(error, at.file) from error

    return checked


class Cursor(sqlite3.Cursor):
    """Rows of an answer; they may turn out to be damaged one by one."""

    def __init__(self, connection: Connection) -> None:
        super().__init__(connection)
        self.file = connection.file

    execute = _telling(sqlite3.Cursor.execute)
    executemany = _telling(sqlite3.Cursor.executemany)
    executescript = _telling(sqlite3.Cursor.executescript)
    fetchone = _telling(sqlite3.Cursor.fetchone)
    fetchall = _telling(sqlite3.Cursor.fetchall)

    def __next__(self) -> Any:
        """The next row."""
        try:
            return super().__next__()
        except sqlite3.DatabaseError as error:
            raise as_kb_error(error, self.file) from error


class Connection(sqlite3.Connection):
    """As sqlite3's, with the file's name in its errors."""

    file = Path()

    def execute(self, sql: str, parameters: Any = (), /) -> Cursor:
        """One statement."""
        return Cursor(self).execute(sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Any], /) -> Cursor:
        """One statement for each of the parameters."""
        return Cursor(self).executemany(sql, parameters)

    def executescript(self, script: str, /) -> sqlite3.Cursor:
        """Several statements."""
        return Cursor(self).executescript(script)
