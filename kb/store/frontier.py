"""What makes a crawl resumable, in one SQLite file: frontier, cursors, ledger, raw offsets.

One connection guarded by one lock: threads of a crawl share it. Readers (`kb status`) open it
read-only beside a running crawl (write-ahead log).
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from kb.core import clock
from kb.core.errors import DamagedData
from kb.store.atomic import full_disk_is_resumable, writing

VERSION = 2
ROUND = "refresh: older than"  # the cursor of a refresh that was asked for by --older-than
_TABLES = """
CREATE TABLE items (
  kind TEXT NOT NULL, key TEXT NOT NULL, seq INTEGER NOT NULL,
  status TEXT NOT NULL CHECK (status IN ('todo', 'in_progress', 'done', 'error', 'skipped')),
  tries INTEGER NOT NULL DEFAULT 0, reason TEXT, payload TEXT,
  PRIMARY KEY (kind, key)) WITHOUT ROWID;
CREATE INDEX items_by_status ON items (kind, status, seq);
CREATE INDEX items_by_order ON items (kind, seq);
CREATE TABLE cursors (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE ledger (
  id INTEGER PRIMARY KEY, at TEXT NOT NULL, day TEXT NOT NULL, bucket TEXT NOT NULL,
  units INTEGER NOT NULL, endpoint TEXT NOT NULL, outcome TEXT);
CREATE INDEX ledger_by_day ON ledger (bucket, day);
CREATE TABLE offsets (kind TEXT NOT NULL, segment TEXT NOT NULL, offset INTEGER NOT NULL,
  PRIMARY KEY (kind, segment)) WITHOUT ROWID;
"""
# MIGRATIONS[n] brings version n to n + 1; the file is copied aside first.
MIGRATIONS = {1: "CREATE INDEX items_by_order ON items (kind, seq);"}
# Asked at each `add`: without an index that answers it, a million keys take hours.
LAST = "SELECT coalesce(max(seq), 0) FROM items WHERE kind = ?"


@dataclass(frozen=True, slots=True)
class Item:
    """One thing to fetch. `payload` is what its source wants to know about it."""

    kind: str
    key: str
    tries: int
    payload: Any


class Frontier:
    """The state of one source. Open it under the source's writer lock, or `readonly`.

    `payloads` gives the type of each kind's payload; those of other kinds are plain JSON values.
    """

    def __init__(
        self,
        path: Path,
        *,
        readonly: bool = False,
        payloads: Mapping[str, type[msgspec.Struct]] | None = None,
    ) -> None:
        self.path, self.payloads = path, payloads or {}
        self._decoders = {
            kind: msgspec.json.Decoder(declared) for kind, declared in self.payloads.items()
        }
        self._lock = threading.RLock()
        self._depth = 0
        try:
            if readonly:
                self._db = sqlite3.connect(
                    f"{path.absolute().as_uri()}?mode=ro",
                    uri=True,
                    check_same_thread=False,
                    timeout=30,
                )
                self._db.isolation_level = None
                return
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(
                path, check_same_thread=False, timeout=30, isolation_level=None
            )
            with full_disk_is_resumable(path):
                self._db.execute("PRAGMA journal_mode = WAL")
                self._db.execute("PRAGMA synchronous = FULL")
                self._db.execute("PRAGMA secure_delete = ON")  # what is removed leaves its page
                self._prepare()
                # Whatever was in flight when the last writer ended is asked again.
                self._db.execute("UPDATE items SET status = 'todo' WHERE status = 'in_progress'")
        except sqlite3.DatabaseError as error:
            raise DamagedData(
                f"the state {path} can't be read: {error}",
                hint="move it away; the next run rebuilds it from the raw data",
            ) from None

    def _prepare(self) -> None:
        version = self._db.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise DamagedData(
                f"{self.path} was written by a newer Lorebase", hint="upgrade Lorebase"
            )
        if version == 0:
            self._db.executescript(f"BEGIN; {_TABLES} PRAGMA user_version = {VERSION}; COMMIT;")
            return
        while version < VERSION:
            self._back_up(self.path.with_name(f"{self.path.name}.v{version}.bak"))
            self._db.executescript(
                f"BEGIN; {MIGRATIONS[version]} PRAGMA user_version = {version + 1}; COMMIT;"
            )
            version += 1

    def _back_up(self, path: Path) -> None:
        """A whole copy, what a killed writer left in the log included."""
        with writing(path) as temporary, contextlib.closing(sqlite3.connect(temporary)) as copy:
            self._db.backup(copy)

    def forget(self) -> None:
        """What was removed stands in no free page, no log and no backup any more.

        Raises DiskFull.
        """
        with self._lock, full_disk_is_resumable(self.path):
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
        with self._lock, full_disk_is_resumable(self.path):
            if self._depth == 0:
                self._execute("BEGIN IMMEDIATE")
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
                    self._execute("COMMIT")
                except BaseException:
                    self._rollback()
                    raise

    def _rollback(self) -> None:
        # SQLite has rolled back by itself where it found no room.
        if self._depth == 0 and self._db.in_transaction:
            self._db.execute("ROLLBACK")

    def _execute(self, sql: str, values: Any = ()) -> sqlite3.Cursor:
        try:
            return self._db.execute(sql, values)
        except sqlite3.OperationalError as error:
            if "full" in str(error) or "disk I/O" in str(error):
                raise OSError(28, str(error), str(self.path)) from error
            raise

    def add(self, kind: str, keys: Iterable[str | tuple[str, Any]]) -> int:
        """Add keys that are not known yet; how many were new.

        Order of adding is order of taking.
        """
        with self.transaction():
            before = self._db.total_changes
            seq = self._db.execute(LAST, (kind,)).fetchone()[0]
            rows = ((kind, *_pair(entry), number) for number, entry in enumerate(keys, seq + 1))
            self._db.executemany(
                "INSERT OR IGNORE INTO items (kind, key, payload, seq, status) VALUES (?,"
                " ?, ?, ?, 'todo')",
                rows,
            )
            return self._db.total_changes - before

    def take(self, kind: str, n: int = 1) -> list[Item]:
        """Up to `n` items to do, oldest first; they are in progress until answered."""
        with self.transaction():
            rows = self._db.execute(
                "SELECT key, tries, payload FROM items WHERE kind = ? AND status = 'todo'"
                " ORDER BY seq LIMIT ?",
                (kind, n),
            ).fetchall()
            self._db.executemany(
                "UPDATE items SET status = 'in_progress' WHERE kind = ? AND key = ?",
                [(kind, row[0]) for row in rows],
            )
        return [Item(kind, key, tries, self._decode(kind, payload)) for key, tries, payload in rows]

    def mark(self, kind: str, keys: Iterable[str], status: str, reason: str | None = None) -> None:
        """Set the status of known keys; an "error" counts one try."""
        with self.transaction():
            self._db.executemany(
                "UPDATE items SET status = ?, reason = ?, tries = tries + ?"
                " WHERE kind = ? AND key = ?",
                [(status, reason, int(status == "error"), kind, key) for key in keys],
            )

    def done(self, kind: str, *keys: str) -> None:
        """The items were answered."""
        self.mark(kind, keys, "done")

    def error(self, kind: str, key: str, reason: str) -> None:
        """The item failed after its tries; the next run tries it again."""
        self.mark(kind, [key], "error", reason)

    def skip(self, kind: str, key: str, reason: str) -> None:
        """The item is final without content."""
        self.mark(kind, [key], "skipped", reason)

    def release(self, kind: str, *keys: str) -> None:
        """Give items back that were taken but not asked for."""
        self.mark(kind, keys, "todo")

    def reopen(self, kind: str, *statuses: str) -> int:
        """Items of these statuses become todo again; how many."""
        with self.transaction():
            marks = ", ".join("?" * len(statuses))
            return self._db.execute(
                f"UPDATE items SET status = 'todo' WHERE kind = ? AND status IN ({marks})",
                (kind, *statuses),
            ).rowcount

    def payload(self, kind: str, key: str, value: Any) -> None:
        """Replace what is known about an item."""
        with self.transaction():
            self._db.execute(
                "UPDATE items SET payload = ? WHERE kind = ? AND key = ?", (_json(value), kind, key)
            )

    def get(self, kind: str, key: str) -> tuple[str, Any, str | None] | None:
        """(status, payload, reason) of an item, None when it is not known."""
        with self._lock:
            row = self._db.execute(
                "SELECT status, payload, reason FROM items WHERE kind = ? AND key = ?", (kind, key)
            ).fetchone()
        return None if row is None else (row[0], self._decode(kind, row[1]), row[2])

    def items(self, kind: str, *statuses: str) -> Iterator[tuple[str, str, str | None, Any]]:
        """(key, status, reason, payload) of all items of a kind, oldest first;
        their list is held in memory.
        """
        marks = f"AND status IN ({', '.join('?' * len(statuses))})" if statuses else ""
        with self._lock:
            rows = self._db.execute(
                f"SELECT key, status, reason, payload FROM items WHERE kind = ? {marks}"
                " ORDER BY seq",
                (kind, *statuses),
            ).fetchall()
        for key, status, reason, payload in rows:
            yield key, status, reason, self._decode(kind, payload)

    def _decode(self, kind: str, payload: str | None) -> Any:
        """A payload as its kind's type. Raises DamagedData when it is not one."""
        if not payload:
            return None
        try:
            decoder = self._decoders.get(kind)
            return decoder.decode(payload) if decoder else msgspec.json.decode(payload)
        except (msgspec.DecodeError, msgspec.ValidationError) as error:
            raise DamagedData(
                f"the state {self.path} holds an unreadable item of {kind}: {error}",
                hint="move it away; the next run rebuilds it from the raw data",
            ) from None

    def remove(self, kind: str, keys: Iterable[str]) -> None:
        """Forget items (purge)."""
        with self.transaction():
            self._db.executemany(
                "DELETE FROM items WHERE kind = ? AND key = ?", [(kind, key) for key in keys]
            )

    def replace(self, kind: str, keys: Iterable[str | tuple[str, Any]]) -> int:
        """Forget all items of a kind and add these instead, as one change; how many there are."""
        with self.transaction():
            self._execute("DELETE FROM items WHERE kind = ?", (kind,))
            return self.add(kind, keys)

    def counts(self, kind: str) -> dict[str, int]:
        """How many items of a kind have which status; statuses without items are left out."""
        with self._lock:
            return dict(
                self._db.execute(
                    "SELECT status, count(*) FROM items WHERE kind = ? GROUP BY status", (kind,)
                ).fetchall()
            )

    def ready(self, kind: str, most: int = 1) -> int:
        """How many items of a kind are to do,
        counted up to `most`: quick however many there are.
        """
        with self._lock:
            row = self._db.execute(
                "SELECT count(*) FROM (SELECT 1 FROM items WHERE kind = ?"
                " AND status = 'todo' LIMIT ?)",
                (kind, most),
            ).fetchone()
            return int(row[0])

    def waiting(self, *kinds: str) -> int:
        """How many items of these kinds have no answer yet, those in progress included."""
        counts = (self.counts(kind) for kind in kinds)
        return sum(count.get("todo", 0) + count.get("in_progress", 0) for count in counts)

    def kinds(self) -> dict[str, dict[str, int]]:
        """Counts by status of every kind, by name."""
        found: dict[str, dict[str, int]] = {}
        with self._lock:
            rows = self._db.execute(
                "SELECT kind, status, count(*) FROM items GROUP BY 1, 2 ORDER BY 1, 2"
            ).fetchall()
        for kind, status, n in rows:
            found.setdefault(kind, {})[status] = n
        return found

    def cursor(self, name: str, default: Any = None) -> Any:
        """A value that a source keeps (a page token, a round, a date)."""
        with self._lock:
            row = self._execute("SELECT value FROM cursors WHERE name = ?", (name,)).fetchone()
        return default if row is None else msgspec.json.decode(row[0])

    def set_cursor(self, name: str, value: Any) -> None:
        """Keep a value; None forgets it."""
        with self.transaction():
            if value is None:
                self._db.execute("DELETE FROM cursors WHERE name = ?", (name,))
            else:
                self._db.execute(
                    "INSERT OR REPLACE INTO cursors VALUES (?, ?)", (name, _json(value))
                )

    def spend(self, bucket: str, units: int, endpoint: str, day: str | None = None) -> int:
        """Write a ledger row, committed before the request is sent; its id."""
        with self.transaction():
            at = clock.stamp()
            cursor = self._db.execute(
                "INSERT INTO ledger (at, day, bucket, units, endpoint) VALUES (?, ?, ?, ?, ?)",
                (at, day or at[:10], bucket, units, endpoint),
            )
            return int(cursor.lastrowid or 0)

    def outcome(self, row: int, outcome: str) -> None:
        """What became of a request: an HTTP status or an error's name."""
        with self.transaction():
            self._db.execute("UPDATE ledger SET outcome = ? WHERE id = ?", (outcome, row))

    def spent(self, bucket: str, day: str) -> int:
        """Units of a bucket spent on a day."""
        with self._lock:
            return int(
                self._db.execute(
                    "SELECT coalesce(sum(units), 0) FROM ledger WHERE bucket = ? AND day = ?",
                    (bucket, day),
                ).fetchone()[0]
            )

    def ledger(self) -> list[tuple[str, str, str, int, int]]:
        """(day, bucket, endpoint, requests, units), by day."""
        with self._lock:
            return self._db.execute(
                "SELECT day, bucket, endpoint, count(*), sum(units) FROM ledger"
                " GROUP BY 1, 2, 3 ORDER BY 1, 2, 3"
            ).fetchall()

    def requests(self) -> tuple[int, int]:
        """(requests, units) of all time."""
        with self._lock:
            row = self._db.execute(
                "SELECT count(*), coalesce(sum(units), 0) FROM ledger"
            ).fetchone()
        return int(row[0]), int(row[1])

    def offset(self, kind: str, segment: str) -> int:
        """How far a raw segment was taken into the frontier, in bytes."""
        with self._lock:
            row = self._db.execute(
                "SELECT offset FROM offsets WHERE kind = ? AND segment = ?", (kind, segment)
            ).fetchone()
        return 0 if row is None else int(row[0])

    def offsets(self) -> dict[tuple[str, str], int]:
        """How far each raw segment was taken in, by (kind, segment)."""
        with self._lock:
            rows = self._db.execute("SELECT kind, segment, offset FROM offsets").fetchall()
        return {(kind, segment): int(offset) for kind, segment, offset in rows}

    def drop_offset(self, kind: str, segment: str) -> None:
        """Forget a raw segment that is no longer there."""
        with self.transaction():
            self._db.execute("DELETE FROM offsets WHERE kind = ? AND segment = ?", (kind, segment))

    def set_offset(self, kind: str, segment: str, offset: int) -> None:
        """Note how far a raw segment was taken in, in the transaction of its effects."""
        with self.transaction():
            self._db.execute(
                "INSERT OR REPLACE INTO offsets VALUES (?, ?, ?)", (kind, segment, offset)
            )


def going_on(frontier: Frontier, kind: str, older_than: int | None) -> bool:
    """Whether a refresh with this `--older-than` was stopped and left items:
    they are read before others are sought.
    """
    if older_than is None or frontier.cursor(ROUND) != older_than:
        return False
    return frontier.ready(kind) > 0


def _json(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _pair(entry: str | tuple[str, Any]) -> tuple[str, str | None]:
    if isinstance(entry, str):
        return entry, None
    return entry[0], None if entry[1] is None else _json(entry[1])
