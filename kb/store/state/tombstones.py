"""Keys that were purged: crawl, import and filter skip them for good.

    raw/<source>/tombstones.parquet      what the contract names, and what travels with the raw data
    state/<source>/tombstones.parquet    the same again, as another machine's raw folder copied here
                                         has a file of that name and takes the first one's place

Readers take the union of both, and of other copies beside the first one. Writers complete both.

A person who asked to be left out has a tombstone too, `PERSON` before what stands for them in raw
data without naming them. It keeps away what they publish later, whose keys nobody knows yet, and is
for this data root alone: `keys` and `read`, from which releases are made, leave it out.
"""

import filecmp
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core import clock
from kb.core.errors import DamagedData
from kb.schema.tables import table
from kb.store.atomic import sync_folder
from kb.store.layout import Layout
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table

_TABLE = "shared/tombstones"
PERSON = "person_"


def path(root: Path, source: str) -> Path:
    """Where a source's tombstones are, for others to read."""
    return Layout(root).tombstones(source)[0]


def keys(root: Path, source: str) -> set[str]:
    """The purged keys of a source. Raises DamagedData."""
    return {key for key in _keys(root, source) if not key.startswith(PERSON)}


def people(root: Path, source: str) -> frozenset[str]:
    """What stands for the people whose content a source leaves out. Raises DamagedData."""
    persons = (key for key in _keys(root, source) if key.startswith(PERSON))
    return frozenset(key.removeprefix(PERSON) for key in persons)


def _keys(root: Path, source: str) -> set[str]:
    names: set[str] = set()
    for file in _files(root, source):
        column = _load(file)["key"]
        names.update(cast("list[str]", column.to_pylist()))
    return names


def read(root: Path, source: str) -> pa.Table:
    """Every tombstone of an item of a source once, by key, as shared/tombstones declares;
    of several the oldest. Raises DamagedData.
    """
    files, schema = _files(root, source), table(_TABLE).arrow()
    rows = _load(files[0]) if len(files) == 1 else pa.Table.from_pylist(_union(files), schema)
    return without_people(rows)


def without_people(rows: pa.Table) -> pa.Table:
    """The tombstones of items among these."""
    return rows.filter(pc.invert(pc.starts_with(rows["key"], PERSON)))


def version(root: Path, source: str) -> int:
    """A number that changes when tombstones do, for caches of a process."""
    return sum(file.stat().st_mtime_ns for file in _files(root, source))


def add(root: Path, source: str, rows: Iterable[tuple[str, str]]) -> int:
    """Add (key, reason) pairs; known keys keep their first row. How many were new."""
    files = _files(root, source)
    old = _union(files)
    known = {row["key"] for row in old}
    at = clock.now()
    new = {key: reason for key, reason in rows if key not in known}
    if new or not files:
        _write(
            root,
            source,
            old
            + [
                {"key": key, "source": source, "removed_at": at, "reason": reason}
                for key, reason in new.items()
            ],
        )
    return len(new)


def lift(root: Path, source: str, back: Collection[str], reasons: Collection[str]) -> int:
    """Drop the rows of keys that their service shows again, where the reason is its own; how many.

    What a person asked to remove stays removed: such reasons are not given here.
    """
    rows = _union(_files(root, source))
    kept = [row for row in rows if row["key"] not in back or row["reason"] not in reasons]
    if len(kept) < len(rows):
        _write(root, source, kept)
    return len(rows) - len(kept)


def unite(root: Path, source: str, other: Path) -> None:
    """Add the tombstones of another data root, people's included. Raises DiskFull."""
    theirs = _files(other, source)
    if theirs and _union([*_files(root, source), *theirs]) != _union(_files(root, source)):
        _write(root, source, _union([*_files(root, source), *theirs]))


def heal(root: Path, source: str) -> None:
    """Make both files hold every tombstone. Call it under the writer's lock. Raises DiskFull."""
    files = _files(root, source)
    complete = all(place.exists() for place in Layout(root).tombstones(source))
    if files and (len(files) > 1 or not complete):
        _write(root, source, _union(files))


def _extra_copies(root: Path, source: str) -> list[Path]:
    """Copies that someone put beside the first file under another name (tombstones-b.parquet,
    tombstones.parquet~).
    """
    first = path(root, source)
    copies = first.parent.glob("tombstones*")
    return sorted(file for file in copies if file != first and file.is_file())


def _files(root: Path, source: str) -> list[Path]:
    """The files to read: each content once."""
    files: list[Path] = []
    for file in (*Layout(root).tombstones(source), *_extra_copies(root, source)):
        if not file.exists():
            continue
        others = [] if file.is_dir() else [other for other in files if not other.is_dir()]
        if not any(filecmp.cmp(file, other, shallow=False) for other in others):
            files.append(file)
    return files


def _load(file: Path) -> pa.Table:
    """The rows of one file. Raises DamagedData: one that can't be read is no empty one."""
    rows, why = _read(file)
    if rows is not None:
        return rows
    source = file.parent.name
    places = Layout(file.parents[2]).tombstones(source)
    intact = next(
        (place for place in places if place != file and _read(place)[0] is not None), None
    )
    raise DamagedData(
        f"{file} can't be read: {why}",
        hint=f"remove it: {intact} contains the purged keys as well"
        if intact
        else "restore it from a copy: without it, purged content would return",
    )


def is_readable(file: Path) -> bool:
    """Whether a file holds tombstones that can be read in full."""
    return file.is_file() and _read(file)[0] is not None


def _read(file: Path) -> tuple[pa.Table | None, str]:
    """The rows, or why there are none."""
    schema = table(_TABLE).arrow()
    try:
        rows = parquet.read_table(file)
    except DamagedData as error:
        return None, str(error).removeprefix(f"{file} can't be read: ")
    if any(field.name not in rows.schema.names for field in schema) or any(
        rows.schema.field(field.name).type != field.type for field in schema
    ):
        return None, "it is not a table of tombstones"
    return rows, ""


def _union(files: list[Path]) -> list[dict[str, Any]]:
    rows = [row for file in files for row in _load(file).to_pylist()]
    if len(files) > 1:
        rows.sort(key=lambda row: (row["removed_at"], row["reason"]), reverse=True)
        rows = list({row["key"]: row for row in rows}.values())
    return sorted(rows, key=lambda row: row["key"])


def _write(root: Path, source: str, rows: list[dict[str, Any]]) -> None:
    rows_table = pa.Table.from_pylist(rows, table(_TABLE).arrow())
    for place in reversed(Layout(root).tombstones(source)):
        write_table(place, rows_table, _TABLE)
    others = _extra_copies(root, source)
    for other in others:
        other.unlink()
    if others:
        sync_folder(path(root, source).parent)
