"""Keys that were purged: crawl, import and filter skip them for good.

    raw/<source>/tombstones.parquet    what the contract names, and what travels with the raw data
    state/<source>/tombstones.json     how many it has at least: a file that is gone, or another
                                       machine's that was copied over it, is an error

A person who asked to be left out has a tombstone too, `PERSON` before what stands for them in raw
data without naming them. It keeps away what they publish later, whose keys nobody knows yet, and is
for this data root alone: `keys` and `read`, from which releases are made, leave it out.
"""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, cast

import pyarrow as pa

from kb.core import clock
from kb.core.errors import DamagedData
from kb.core.installation import pc
from kb.schema.tables import table
from kb.store.atomic import write_bytes
from kb.store.damage import read_note, unreadable
from kb.store.layout import Layout
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table

_TABLE = "shared/tombstones"
PERSON = "person_"


def path(root: Path, source: str) -> Path:
    """Where a source's tombstones are, for others to read."""
    return Layout(root).tombstones(source)


def keys(root: Path, source: str) -> set[str]:
    """The purged keys of a source. Raises DamagedData."""
    return {key for key in _keys(root, source) if not key.startswith(PERSON)}


def people(root: Path, source: str) -> frozenset[str]:
    """What stands for the people whose content a source leaves out. Raises DamagedData."""
    persons = (key for key in _keys(root, source) if key.startswith(PERSON))
    return frozenset(key.removeprefix(PERSON) for key in persons)


def _keys(root: Path, source: str) -> set[str]:
    return set(cast("list[str]", _load(root, source)["key"].to_pylist()))


def tombstone_rows(root: Path, source: str) -> pa.Table:
    """Every tombstone of an item of a source, by key, as shared/tombstones declares.
    Raises DamagedData.
    """
    return without_people(_load(root, source))


def without_people(rows: pa.Table) -> pa.Table:
    """The tombstones of items among these."""
    return rows.filter(pc.invert(pc.starts_with(rows["key"], PERSON)))


def version(root: Path, source: str) -> int:
    """A number that changes when tombstones do, for caches of a process."""
    file = path(root, source)
    return file.stat().st_mtime_ns if file.exists() else 0


def add_tombstones(root: Path, source: str, rows: Iterable[tuple[str, str]]) -> int:
    """Add (key, reason) pairs; known keys keep their first row. How many were new."""
    old = _load(root, source).to_pylist()
    known = {row["key"] for row in old}
    at = clock.now()
    new = {key: reason for key, reason in rows if key not in known}
    if new or not path(root, source).exists():
        added = [
            {"key": key, "source": source, "removed_at": at, "reason": reason}
            for key, reason in new.items()
        ]
        _write(root, source, old + added)
    return len(new)


def lift(root: Path, source: str, back: Collection[str], reasons: Collection[str]) -> int:
    """Drop the rows of keys that their service shows again, where the reason is its own; how many.

    What a person asked to remove stays removed: such reasons are not given here.
    """
    rows = _load(root, source).to_pylist()
    kept = [row for row in rows if row["key"] not in back or row["reason"] not in reasons]
    if len(kept) < len(rows):
        _write(root, source, kept)
    return len(rows) - len(kept)


def unite(root: Path, source: str, other: Path) -> None:
    """Add the tombstones of another data root, people's included; of a key that both have the older
    one stays. Raises DamagedData, DiskFull.
    """
    ours, theirs = _load(root, source).to_pylist(), _load(other, source).to_pylist()
    rows = sorted(ours + theirs, key=lambda row: (row["removed_at"], row["reason"]), reverse=True)
    united = {row["key"]: row for row in rows}
    if united != {row["key"]: row for row in ours}:
        _write(root, source, [*united.values()])


def _load(root: Path, source: str) -> pa.Table:
    """Every row, people's included. Raises DamagedData: a file that can't be read is no empty one,
    nor is one that is gone.
    """
    schema, file, count = table(_TABLE).arrow(), path(root, source), _count(root, source)
    restore = "restore it from a copy: without it, purged content would return"
    if not file.exists():
        if count:
            raise DamagedData(f"{file} is missing", hint=restore, paths=[file])
        return schema.empty_table()
    try:
        rows = parquet.read_table(file)
    except DamagedData as error:
        error.hint = restore
        raise
    if any(name not in rows.schema.names for name in schema.names) or any(
        rows.schema.field(field.name).type != field.type for field in schema
    ):
        raise unreadable(file, "it is not a table of tombstones", restore)
    if rows.num_rows < count:
        raise DamagedData(
            f"{file} has {rows.num_rows:,} of the {count:,} tombstones of this data root",
            hint="restore it from a copy; bring another machine's data over with `kb merge`,"
            " which keeps the tombstones of both",
            paths=[file],
        )
    return rows


def _count(root: Path, source: str) -> int:
    place = Layout(root).tombstone_count(source)
    fix = f"remove it: it only says how many rows {path(root, source)} has"
    count = read_note(place, int, fix=fix)
    copy = place.with_suffix(".parquet")  # of the tombstones, as an older version kept it
    if count is None and copy.is_file():
        count = parquet.read_table(copy).num_rows
    return count or 0


def _write(root: Path, source: str, rows: list[dict[str, Any]]) -> None:
    place, before = Layout(root).tombstone_count(source), _count(root, source)
    place.parent.mkdir(parents=True, exist_ok=True)
    if len(rows) < before:  # killed in between, the count never says more than there are
        write_bytes(place, str(len(rows)).encode())
    rows.sort(key=lambda row: row["key"])
    write_table(path(root, source), pa.Table.from_pylist(rows, table(_TABLE).arrow()), _TABLE)
    write_bytes(place, str(len(rows)).encode())
