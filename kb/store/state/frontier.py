"""The items that a crawl still has to fetch, by kind and status."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from kb.net import redact
from kb.store.state.crawl_state import PUT_BACK, UNREADABLE, State, as_json

ROUND = "refresh: older than"  # the cursor of a refresh that was asked for by --older-than
# Asked at each `add`: without an index that answers it, a million keys take hours.
_END = 2**63 - 1
LAST = "SELECT coalesce(max(seq), 0) FROM items WHERE kind = ?"


@dataclass(frozen=True, slots=True)
class Item:
    """One thing to fetch. `payload` is what its source wants to know about it.

    `failed`: an earlier run asked for it in vain.
    """

    kind: str
    key: str
    payload: Any
    failed: bool = False


class Frontier(State):
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
        self.payloads = payloads or {}
        self._decoders = {
            kind: msgspec.json.Decoder(declared) for kind, declared in self.payloads.items()
        }
        super().__init__(path, readonly=readonly)

    def add_keys(self, kind: str, keys: Iterable[str | tuple[str, Any]]) -> int:
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

    def take(
        self, kind: str, n: int = 1, *, failed_upto: int | None = None, newest: bool = False
    ) -> list[Item]:
        """Up to `n` items to do, oldest first unless `newest`; they are in progress until answered.

        With `failed_upto` those that failed before that place in the queue (see `last`) instead.
        """
        order = "DESC" if newest else "ASC"
        with self.transaction():
            rows = self._db.execute(
                "SELECT key, payload FROM items WHERE kind = ? AND status = ? AND seq <= ?"
                f" ORDER BY seq {order} LIMIT ?",
                (kind, *_queue(failed_upto), n),
            ).fetchall()
            self._db.executemany(
                "UPDATE items SET status = 'in_progress' WHERE kind = ? AND key = ?",
                [(kind, row[0]) for row in rows],
            )
        failed = failed_upto is not None
        return [Item(kind, key, self._decode(kind, payload), failed) for key, payload in rows]

    def last(self, kind: str) -> int:
        """The last place in the queue of a kind; what fails later goes behind it."""
        with self._access():
            return int(self._db.execute(LAST, (kind,)).fetchone()[0])

    def answered(self, kind: str) -> Item | None:
        """An item that the service has answered, None when there is none."""
        with self._access():
            row = self._db.execute(
                "SELECT key, payload FROM items WHERE kind = ? AND status = 'done'"
                " ORDER BY seq DESC LIMIT 1",
                (kind,),
            ).fetchone()
        return None if row is None else Item(kind, row[0], self._decode(kind, row[1]))

    def mark(self, kind: str, keys: Iterable[str], status: str, reason: str | None = None) -> None:
        """Set the status of known keys, one after the other; failed ones go to the queue's end.

        A reason may be a service's words, which may repeat our request: it is kept without secrets.
        """
        reason = redact.text(reason) if reason else reason
        with self.transaction():
            self._db.executemany(
                "UPDATE items SET status = ?1, reason = ?2, seq = CASE ?1 WHEN 'error'"
                " THEN (SELECT max(seq) + 1 FROM items WHERE kind = ?3) ELSE seq END"
                " WHERE kind = ?3 AND key = ?4",
                ((status, reason, kind, key) for key in keys),
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

    def release(self, kind: str, *keys: str, last: bool = False) -> None:
        """Give items back that were taken: to do, or failed as before; `last` puts them at the end
        of the queue.
        """
        end = "(SELECT max(seq) + 1 FROM items WHERE kind = ?1)" if last else "seq"
        with self.transaction():
            self._db.executemany(
                f"UPDATE items SET {PUT_BACK}, seq = {end} WHERE kind = ?1 AND key = ?2",
                ((kind, key) for key in keys),
            )

    def reopen(self, kind: str, *statuses: str) -> int:
        """Items of these statuses become todo again; how many."""
        with self.transaction():
            marks = ", ".join("?" * len(statuses))
            return self._db.execute(
                "UPDATE items SET status = 'todo', reason = NULL WHERE kind = ?"
                f" AND status IN ({marks})",
                (kind, *statuses),
            ).rowcount

    def payload(self, kind: str, key: str, value: Any) -> None:
        """Replace what is known about an item."""
        with self.transaction():
            self._db.execute(
                "UPDATE items SET payload = ? WHERE kind = ? AND key = ?",
                (as_json(value), kind, key),
            )

    def get(self, kind: str, key: str) -> tuple[str, Any, str | None] | None:
        """(status, payload, reason) of an item, None when it is not known."""
        with self._access():
            row = self._db.execute(
                "SELECT status, payload, reason FROM items WHERE kind = ? AND key = ?", (kind, key)
            ).fetchone()
        return None if row is None else (row[0], self._decode(kind, row[1]), row[2])

    def items(self, kind: str, *statuses: str) -> Iterator[tuple[str, str, str | None, Any]]:
        """(key, status, reason, payload) of all items of a kind, oldest first;
        their list is held in memory.
        """
        marks = f"AND status IN ({', '.join('?' * len(statuses))})" if statuses else ""
        with self._access():
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
        except UNREADABLE as error:
            raise self._damaged(f"an item of {kind}: {error}") from None

    def remove(self, kind: str, keys: Iterable[str]) -> None:
        """Forget items (purge)."""
        with self.transaction():
            pairs = [(kind, key) for key in keys]
            for table in ("items", "lost"):
                self._db.executemany(f"DELETE FROM {table} WHERE kind = ? AND key = ?", pairs)

    def replace(self, kind: str, keys: Iterable[str | tuple[str, Any]]) -> int:
        """Forget all items of a kind and add these instead, as one change; how many there are."""
        with self.transaction():
            self._db.execute("DELETE FROM items WHERE kind = ?", (kind,))
            self._db.execute("DELETE FROM lost WHERE kind = ?", (kind,))
            return self.add_keys(kind, keys)

    # -- a replay of the raw log -------------------------------------------------------------------

    def start_over(self) -> None:
        """Forget all that a replay of the raw log gives; `settle` takes back the rest of it.

        The ledger stays: no raw answer says what was spent.
        """
        with self.transaction():
            for table in ("items", "cursors"):
                self._db.execute(
                    f"CREATE TABLE IF NOT EXISTS earlier_{table} AS SELECT * FROM {table}"
                )
                self._db.execute(f"DELETE FROM {table}")
            self._db.execute("DELETE FROM offsets")

    def settle(self, asked: Collection[str]) -> list[tuple[str, str]]:
        """Take back what no raw answer says, at the end of a replay: items that are to do, and
        cursors. Items of the kinds in `asked` that were answered, and that no raw answer shows any
        more, are to do again, and returned as (kind, key).
        """
        marks = ", ".join("?" * len(asked))
        with self.transaction():
            if not self._has_table("earlier_items"):
                return []
            lost = self._db.execute(
                "SELECT kind, key FROM earlier_items AS earlier LEFT JOIN items USING (kind, key)"
                f" WHERE kind IN ({marks}) AND earlier.status IN ('done', 'skipped')"
                " AND coalesce(items.status, '') NOT IN ('done', 'skipped')"
                " ORDER BY kind, earlier.seq",
                (*asked,),
            ).fetchall()
            self._db.execute(
                "INSERT OR IGNORE INTO items (kind, key, seq, status, reason, payload) SELECT kind,"
                f" key, seq, CASE WHEN kind IN ({marks}) THEN 'todo' ELSE status END, NULL, payload"
                " FROM earlier_items",
                (*asked,),
            )
            self._db.execute(
                "UPDATE items SET status = earlier.status, reason = earlier.reason"
                " FROM earlier_items AS earlier WHERE earlier.kind = items.kind"
                " AND earlier.key = items.key AND earlier.status IN ('todo', 'error')"
            )
            self.note_lost(lost)
            self._db.execute("INSERT OR REPLACE INTO cursors SELECT * FROM earlier_cursors")
            self._db.execute("DROP TABLE earlier_items")
            self._db.execute("DROP TABLE earlier_cursors")
        return lost

    def note_lost(self, items: Iterable[tuple[str, str]]) -> None:
        """Note items (kind, key) whose answers are lost."""
        with self.transaction():
            self._db.executemany("INSERT OR IGNORE INTO lost VALUES (?, ?)", items)

    def lost(self) -> list[tuple[str, str]]:
        """The items whose answers are lost and that were not asked for again."""
        with self._access():
            if not self._has_table("lost"):  # of an older version, opened to be read
                return []
            return self._db.execute(
                "SELECT kind, key FROM lost LEFT JOIN items USING (kind, key)"
                " WHERE coalesce(status, 'todo') IN ('todo', 'in_progress') ORDER BY 1, 2"
            ).fetchall()

    def forget_fetched(self) -> None:
        """What was asked for again is lost no longer."""
        with self.transaction():
            still = self.lost()
            self._db.execute("DELETE FROM lost")
            self.note_lost(still)

    def forget_lost(self, kind: str) -> None:
        """What was lost of a kind came back in another way."""
        with self.transaction():
            self._db.execute("DELETE FROM lost WHERE kind = ?", (kind,))

    def _has_table(self, name: str) -> bool:
        sql = "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?"
        return self._db.execute(sql, (name,)).fetchone() is not None

    def counts(self, kind: str) -> dict[str, int]:
        """How many items of a kind have which status; statuses without items are left out."""
        with self._access():
            return dict(
                self._db.execute(
                    "SELECT status, count(*) FROM items WHERE kind = ? GROUP BY status", (kind,)
                ).fetchall()
            )

    def ready(self, kind: str, most: int = 1, *, failed_upto: int | None = None) -> int:
        """How many items of a kind `take` would give,
        counted up to `most`: quick however many there are.
        """
        with self._access():
            row = self._db.execute(
                "SELECT count(*) FROM (SELECT 1 FROM items WHERE kind = ?"
                " AND status = ? AND seq <= ? LIMIT ?)",
                (kind, *_queue(failed_upto), most),
            ).fetchone()
            return int(row[0])

    def waiting(self, *kinds: str) -> int:
        """How many items of these kinds have no answer yet, those in progress included."""
        counts = (self.counts(kind) for kind in kinds)
        return sum(count.get("todo", 0) + count.get("in_progress", 0) for count in counts)

    def open(self, *kinds: str) -> int:
        """How many items of these kinds a run has to ask for: those that wait or have failed."""
        return self.waiting(*kinds) + sum(self.counts(kind).get("error", 0) for kind in kinds)

    def failures(self) -> dict[str, int]:
        """How many items failed for which reason, the most frequent first."""
        with self._access():
            return dict(
                self._db.execute(
                    "SELECT coalesce(reason, 'unknown'), count(*) FROM items"
                    " WHERE status = 'error' GROUP BY 1 ORDER BY 2 DESC, 1"
                ).fetchall()
            )

    def kinds(self) -> dict[str, dict[str, int]]:
        """Counts by status of every kind, by name."""
        kinds: dict[str, dict[str, int]] = {}
        with self._access():
            rows = self._db.execute(
                "SELECT kind, status, count(*) FROM items GROUP BY 1, 2 ORDER BY 1, 2"
            ).fetchall()
        for kind, status, n in rows:
            kinds.setdefault(kind, {})[status] = n
        return kinds


def going_on(frontier: Frontier, kind: str, older_than: int | None) -> bool:
    """Whether a refresh with this `--older-than` was stopped and left items:
    they are read before others are sought.
    """
    if older_than is None or frontier.cursor(ROUND) != older_than:
        return False
    return frontier.ready(kind) > 0


def _queue(failed_upto: int | None) -> tuple[str, int]:
    """Status and last place of the items to take."""
    return ("todo", _END) if failed_upto is None else ("error", failed_upto)


def _pair(entry: str | tuple[str, Any]) -> tuple[str, str | None]:
    if isinstance(entry, str):
        return entry, None
    return entry[0], None if entry[1] is None else as_json(entry[1])
