"""What makes a crawl resumable, in one SQLite file: frontier, cursors, ledger, raw offsets.

One connection guarded by one lock: threads of a crawl share it. Readers (`kb status`) open it
read-only while a crawl runs (write-ahead log). Errors name the file and say what to do:

disk full           DiskFull: the same command resumes
permission denied   FatalError: the file is not damaged
locked              FatalError: another program uses it
I/O error           FatalError
anything else       DamagedData: move the file away, and the next run rebuilds it
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock
from kb.core.errors import DamagedData, FatalError, NewerVersion
from kb.core.regular_file import NotRegular, check_regular
from kb.store.atomic import writing
from kb.store.exhausted import as_disk_full, disk_full

REBUILT = "move it away; the next run rebuilds it from the raw data"
_FULL = {
    "SQLITE_FULL",
    "SQLITE_IOERR_WRITE",
    "SQLITE_IOERR_FSYNC",
    "SQLITE_IOERR_TRUNCATE",
    "SQLITE_IOERR_SHMSIZE",
}
VERSION = 3
_CACHE_KIB = 64 << 10
_TABLES = """
CREATE TABLE items (
  kind TEXT NOT NULL, key TEXT NOT NULL, seq INTEGER NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('todo', 'in_progress', 'done', 'error', 'skipped')),
  reason TEXT, payload TEXT,
  PRIMARY KEY (kind, key)) WITHOUT ROWID;
CREATE INDEX items_by_status ON items (kind, status, seq);
CREATE INDEX items_by_order ON items (kind, seq);
CREATE TABLE cursors (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE ledger (
  id INTEGER PRIMARY KEY, at TEXT NOT NULL, day TEXT NOT NULL, bucket TEXT NOT NULL,
  units INTEGER NOT NULL, endpoint TEXT NOT NULL, outcome TEXT, uid TEXT NOT NULL UNIQUE);
CREATE INDEX ledger_by_day ON ledger (bucket, day);
CREATE TABLE lost (kind TEXT NOT NULL, key TEXT NOT NULL, PRIMARY KEY (kind, key)) WITHOUT ROWID;
CREATE TABLE offsets (kind TEXT NOT NULL, segment TEXT NOT NULL, offset INTEGER NOT NULL,
  PRIMARY KEY (kind, segment)) WITHOUT ROWID;
"""
# MIGRATIONS[n] brings version n to n + 1; the file is copied aside first.
# `uid` names a request on whatever machine its row lies; of older rows it is made of their values.
_OLD_UID = "at || ' ' || bucket || ' ' || endpoint || ' ' || id"
_FIRST_WITH_UID = 3
MIGRATIONS = {
    1: "CREATE INDEX items_by_order ON items (kind, seq);",
    2: f"""
ALTER TABLE ledger ADD COLUMN uid TEXT;
UPDATE ledger SET uid = {_OLD_UID};
CREATE UNIQUE INDEX ledger_by_uid ON ledger (uid);
CREATE TABLE lost (kind TEXT NOT NULL, key TEXT NOT NULL, PRIMARY KEY (kind, key)) WITHOUT ROWID;
DELETE FROM cursors WHERE name IN ('lost', 'suspects') OR name LIKE 'merged %';
""",
}
# Of an item in progress: one that had failed before keeps its reason until it is answered.
PUT_BACK = "status = CASE WHEN reason IS NULL THEN 'todo' ELSE 'error' END"
UNREADABLE = (msgspec.DecodeError, TypeError, RecursionError, UnicodeDecodeError)


def connect(path: Path, *, readonly: bool = False) -> sqlite3.Connection:
    """Open or make the file, for several threads under a lock of the caller's own. Raises
    FatalError where it or a file of its log is no regular file.
    """
    if not readonly and not path.exists():
        # A log without its file belongs to one that was moved away: it would fill the new one.
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
    for suffix in ("", "-wal", "-shm"):  # SQLite would wait for a FIFO
        try:
            check_regular(f"{path}{suffix}")
        except FileNotFoundError:
            continue
        except NotRegular as error:
            if path.is_dir():  # which SQLite refuses by itself
                break
            why = f"the state {error.filename} can't be opened: {error.strerror}"
            raise FatalError(why, hint=REBUILT) from None
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
    # Without free inodes SQLite can create neither the file nor its log.
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


class State:
    """The file: its tables and changes, and all of them but the items (kb.store.state.frontier)."""

    def __init__(self, path: Path, *, readonly: bool = False) -> None:
        self.path = path
        self._lock = threading.RLock()
        self._depth = 0
        with explained(path):
            if readonly:
                self._db = connect(path, readonly=True)
                return
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = connect(path)
            try:
                self._db.execute("PRAGMA journal_mode = WAL")
                self._db.execute("PRAGMA synchronous = FULL")  # on disk when a commit returns
                self._db.execute("PRAGMA secure_delete = ON")  # what is removed leaves its page
                # Millions of items in one transaction would be written again and again with the
                # 2 MiB that SQLite takes by itself.
                self._db.execute(f"PRAGMA cache_size = -{_CACHE_KIB}")
                self._prepare()
                # Whatever was in flight when the last writer ended is asked again.
                self._db.execute(f"UPDATE items SET {PUT_BACK} WHERE status = 'in_progress'")
            except BaseException:
                self._db.close()
                raise

    @contextlib.contextmanager
    def _access(self) -> Iterator[None]:
        """One thread at a time. Raises KbError (kb.store.state.crawl_state)."""
        with self._lock, explained(self.path):
            yield

    def _prepare(self) -> None:
        version = self._db.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise NewerVersion(
                f"{self.path} was written by a newer Lorecrawl", hint="upgrade Lorecrawl"
            )
        if version == 0:
            self._db.executescript(f"BEGIN; {_TABLES} PRAGMA user_version = {VERSION}; COMMIT;")
            return
        if version < 0:
            raise self._damaged(f"its version is {version}")
        while version < VERSION:
            backup = self.path.with_name(f"{self.path.name}.v{version}.bak")
            # Whole: also what a killed writer left in the log only.
            with writing(backup) as fresh, contextlib.closing(sqlite3.connect(fresh)) as copy:
                self._db.backup(copy)
            self._db.executescript(
                f"BEGIN; {MIGRATIONS[version]} PRAGMA user_version = {version + 1}; COMMIT;"
            )
            version += 1

    def forget(self) -> None:
        """What was removed stands in no free page, no log and no backup any more.

        Raises DiskFull.
        """
        with self._access():
            self._db.execute("VACUUM")
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            for backup in self.path.parent.glob(f"{self.path.name}.v*.bak"):
                backup.unlink()

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """All or nothing; may be nested (the outermost one commits)."""
        with self._access():
            if self._depth == 0:
                self._db.execute("BEGIN IMMEDIATE")
            self._depth += 1
            try:
                yield
            except BaseException:
                self._depth -= 1
                self._rollback()
                raise
            self._depth -= 1
            if self._depth == 0:
                try:
                    self._db.execute("COMMIT")
                except BaseException:
                    self._rollback()
                    raise

    def _rollback(self) -> None:
        # SQLite has rolled back by itself where it found no room.
        if self._depth == 0 and self._db.in_transaction:
            self._db.execute("ROLLBACK")

    def _damaged(self, why: str) -> DamagedData:
        return DamagedData(f"the state {self.path} can't be read: {why}", hint=REBUILT)

    def cursor(self, name: str, default: Any = None, of: Any = None) -> Any:
        """A value that a source keeps (a page token, a round, a date).

        It is one of the type `of`, else of its default's. Raises DamagedData when it is not.
        """
        with self._access():
            row = self._db.execute("SELECT value FROM cursors WHERE name = ?", (name,)).fetchone()
        try:
            value = default if row is None else msgspec.json.decode(row[0])
            kind = Any if default is None else type(default)
            return msgspec.convert(value, kind if of is None else of)
        except UNREADABLE as error:
            raise self._damaged(f"the value of {name}: {error}") from None

    def set_cursor(self, name: str, value: Any) -> None:
        """Keep a value; None forgets it."""
        with self.transaction():
            if value is None:
                self._db.execute("DELETE FROM cursors WHERE name = ?", (name,))
            else:
                self._db.execute(
                    "INSERT OR REPLACE INTO cursors VALUES (?, ?)", (name, as_json(value))
                )

    def spend(self, bucket: str, units: int, endpoint: str, day: str | None = None) -> int:
        """Write a ledger row, committed before the request is sent; its id."""
        with self.transaction():
            at = clock.stamp()
            cursor = self._db.execute(
                "INSERT INTO ledger (at, day, bucket, units, endpoint, uid)"
                " VALUES (?, ?, ?, ?, ?, ?)",
                (at, day or at[:10], bucket, units, endpoint, uuid.uuid4().hex),
            )
            return int(cursor.lastrowid or 0)

    def outcome(self, row: int, outcome: str, *, sent: bool = True) -> None:
        """What became of a request: an HTTP status or an error's name.

        One that was never `sent` costs no units.
        """
        with self.transaction():
            self._db.execute(
                "UPDATE ledger SET outcome = ?, units = units * ? WHERE id = ?",
                (outcome, int(sent), row),
            )

    def add_ledger(self, other: State) -> int:
        """Add the requests of another machine's ledger; how many were new.

        The uid tells whether a request is here already. Then it stays as it is, unless it was still
        without an outcome when it was copied here: it takes the outcome and the units from there.
        """
        columns = "at, day, bucket, units, endpoint, outcome, uid"
        with self.transaction(), other._access():
            (version,) = other._db.execute("PRAGMA user_version").fetchone()
            has_uid = version >= _FIRST_WITH_UID  # other states are only read, and not migrated
            selected = columns if has_uid else columns.replace("uid", _OLD_UID)
            requests = other._db.execute(f"SELECT {selected} FROM ledger ORDER BY id")
            before, _ = self.requests()
            self._db.executemany(
                f"INSERT INTO ledger ({columns}) VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (uid)"
                " DO UPDATE SET units = excluded.units, outcome = excluded.outcome"
                " WHERE outcome IS NULL",
                requests,
            )
            after, _ = self.requests()
            return after - before

    def spent(self, bucket: str, day: str) -> int:
        """Units of a bucket spent on a day."""
        with self._access():
            return int(
                self._db.execute(
                    "SELECT coalesce(sum(units), 0) FROM ledger WHERE bucket = ? AND day = ?",
                    (bucket, day),
                ).fetchone()[0]
            )

    def ledger(self) -> list[tuple[str, str, str, int, int]]:
        """(day, bucket, endpoint, requests, units), by day."""
        with self._access():
            return self._db.execute(
                "SELECT day, bucket, endpoint, count(*), sum(units) FROM ledger"
                " GROUP BY 1, 2, 3 ORDER BY 1, 2, 3"
            ).fetchall()

    def requests(self) -> tuple[int, int]:
        """(requests, units) of all time."""
        with self._access():
            row = self._db.execute(
                "SELECT count(*), coalesce(sum(units), 0) FROM ledger"
            ).fetchone()
        return int(row[0]), int(row[1])

    def offset(self, kind: str, segment: str) -> int:
        """How far a raw segment was taken into the frontier, in bytes."""
        with self._access():
            row = self._db.execute(
                "SELECT offset FROM offsets WHERE kind = ? AND segment = ?", (kind, segment)
            ).fetchone()
        return 0 if row is None else self._number(row[0])

    def offsets(self) -> dict[tuple[str, str], int]:
        """How far each raw segment was taken in, by (kind, segment)."""
        with self._access():
            rows = self._db.execute("SELECT kind, segment, offset FROM offsets").fetchall()
        return {(kind, segment): self._number(offset) for kind, segment, offset in rows}

    def _number(self, value: Any) -> int:
        """An offset. Raises DamagedData."""
        if not isinstance(value, int) or value < 0:
            raise self._damaged(f"an offset is {value!r}")
        return value

    def set_offset(self, kind: str, segment: str, offset: int | None) -> None:
        """Note how far a raw segment was taken in, in the transaction of its effects; None forgets
        one that is no longer there.
        """
        with self.transaction():
            if offset is None:
                self._db.execute(
                    "DELETE FROM offsets WHERE kind = ? AND segment = ?", (kind, segment)
                )
            else:
                self._db.execute(
                    "INSERT OR REPLACE INTO offsets VALUES (?, ?, ?)", (kind, segment, offset)
                )


def as_json(value: Any) -> str:
    """A payload or a cursor as it is kept."""
    return msgspec.json.encode(value).decode()
