"""Keys that were purged: crawl, import and filter skip them for good."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

from kb.core import clock
from kb.schema.tables import table
from kb.store.shards import write_table


def path(root: Path, source: str) -> Path:
    """Where a source's tombstones are."""
    return root / "raw" / source / "tombstones.parquet"


def keys(root: Path, source: str) -> set[str]:
    """The purged keys of a source."""
    file = path(root, source)
    if not file.exists():
        return set()
    import pyarrow.parquet as pq

    return set(pq.read_table(file, columns=["key"])["key"].to_pylist())


def add(root: Path, source: str, rows: Iterable[tuple[str, str]]) -> int:
    """Add (key, reason) pairs; known keys keep their first row. How many were new."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = path(root, source)
    old = pq.read_table(file).to_pylist() if file.exists() else []
    known = {row["key"] for row in old}
    at = clock.now()
    new = {key: reason for key, reason in rows if key not in known}
    if not new and file.exists():
        return 0
    merged = old + [{"key": key, "source": source, "removed_at": at, "reason": reason} for key, reason in new.items()]
    merged.sort(key=lambda row: row["key"])
    write_table(file, pa.Table.from_pylist(merged, table("shared/tombstones").arrow()), "shared/tombstones")
    return len(new)


def lift(root: Path, source: str, back: Collection[str], reasons: Collection[str]) -> int:
    """Drop the rows of keys that their service shows again, where the reason is its own; how many.

    What a person asked to remove stays removed: such reasons are not given here.
    """
    import pyarrow.parquet as pq

    file = path(root, source)
    if not file.exists():
        return 0
    old = pq.read_table(file)
    rows = old.to_pylist()
    kept = [row for row in rows if row["key"] not in back or row["reason"] not in reasons]
    if len(kept) < len(rows):
        write_table(file, old.from_pylist(kept, old.schema), "shared/tombstones")
    return len(rows) - len(kept)
