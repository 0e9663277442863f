"""What earlier runs of `kb reddit reconstruct` brought into a folder, and how a new run adds to it.

By id the newest answer wins. What Reddit now says is gone leaves the tables; what only could not be
had this time (failed, forbidden, malformed) leaves the older row as it is.

    out/.done.json     which lists of ids were answered whole, and how many rows the tables have
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, cast

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.reddit.tree import depths
from kb.schema import table
from kb.store import parquet
from kb.store.atomic import settle_folder, write_bytes
from kb.store.layout import parquet_files
from kb.store.newest import newest
from kb.store.reading import reading
from kb.store.shuffle import Shuffle

DONE, MISSING = ".done.json", "missing.parquet"
NAMES = ("posts", "comments")
GONE = ("deleted", "removed", "missing", "purged")  # Reddit's or the user's own last word
_SINCE = "writes"  # in a work folder: how often the tables had been written when it began
_ROWS = 65_536


class Done(msgspec.Struct):
    """`answered`: the summary of each list of ids, by its digest. `writes` counts changes of the
    tables.
    """

    answered: dict[str, dict[str, Any]] = {}
    counts: dict[str, int] = {}
    writes: int = 0


def settle(out: Path) -> None:
    """Finish or undo what a run that was killed was about to put in place."""
    for name in NAMES:
        settle_folder(out / name)


def load(out: Path) -> Done:
    """What is done in `out`; where tables are not whole, or a version before wrote this, nothing
    is.
    """
    try:
        done = msgspec.json.decode((out / DONE).read_bytes(), type=Done)
    except (OSError, msgspec.DecodeError):
        return Done()
    return done if _are_whole(out, done.counts) else Done(writes=done.writes)


def save(out: Path, done: Done) -> None:
    """Keep it. Raises DiskFull."""
    write_bytes(out / DONE, msgspec.json.encode(done))


def begin(work: Path, done: Done) -> bool:
    """Note in a fresh work folder when it began; whether other runs have written since in one that
    goes on.
    """
    path = work / _SINCE
    if not path.exists():
        write_bytes(path, str(done.writes).encode())
        return False
    return path.read_text() != str(done.writes)


def wrote(work: Path, done: Done) -> None:
    """The tables hold the answers of this work folder."""
    write_bytes(work / _SINCE, str(done.writes).encode())


def size(out: Path) -> int:
    """Rows of the tables in `out`. Raises DamagedData."""
    paths = [path for name in NAMES for path in parquet_files(out / name)]
    with reading(paths):
        return sum(pq.read_metadata(path).num_rows for path in paths)


def missing(out: Path) -> dict[str, str]:
    """Key → reason of what earlier runs did not get. Raises DamagedData."""
    path = out / MISSING
    if not path.exists():
        return {}
    with reading([path]):
        rows = parquet.read_table(path, columns=["key", "reason"])
    keys = cast("list[str]", rows["key"].to_pylist())
    return dict(zip(keys, cast("list[str]", rows["reason"].to_pylist()), strict=True))


def spread(out: Path, folder: Path, buckets: int) -> None:
    """Rows of the tables → `folder/<bucket>/old-<name>.arrow`, by post. Raises DamagedData,
    DiskFull.
    """
    for name in NAMES:
        schema = table(f"reddit/{name}").arrow()
        parts = parquet_files(out / name)
        with Shuffle(folder, f"old-{name}", buckets) as shuffle, reading(parts):
            for path in parts:
                for batch in parquet.open_file(path).iter_batches(_ROWS):
                    rows = _declared(pa.Table.from_batches([batch]), schema)
                    shuffle.write(rows, rows["post_id"])


def merged(
    name: str, number: int, folder: Path, fresh: pa.Table, gone: Collection[str]
) -> pa.Table:
    """The rows of a bucket: `fresh` ones and what `spread` put there, by id the one that was read
    last.

    Full names in `gone` are in no table any more.
    """
    path, key = folder / str(number) / f"old-{name}.arrow", table(f"reddit/{name}").key[0]
    parts = [_declared(fresh, fresh.schema)]
    if path.exists():
        with pa.ipc.open_file(str(path)) as file:
            parts.insert(0, _declared(file.read_all(), fresh.schema))
    rows = newest(pa.concat_tables(parts), [key], ["fetched_at"])
    prefix = "t3_" if name == "posts" else "t1_"
    out = [full.removeprefix(prefix) for full in gone if full.startswith(prefix)]
    return rows.filter(pc.invert(pc.is_in(rows[key], value_set=pa.array(out, pa.string()))))


def deep(comments: pa.Table) -> pa.Table:
    """Depths that no run knew by itself, from the comments of all of them."""
    keys = cast("list[str]", comments["comment_id"].to_pylist())
    known = depths(zip(keys, comments["parent_id"].to_pylist(), strict=True))
    found = pa.array([known.get(key) for key in keys], pa.int64())
    place = comments.column_names.index("depth")
    return comments.set_column(place, "depth", pc.coalesce(comments["depth"], found))


def reasons(
    old: Mapping[str, str], new: Mapping[str, str], *, stale: bool
) -> tuple[dict[str, str], set[str]]:
    """Why things are missing after both, and which of them leave the tables.

    `stale`: other runs have written since the new answers were read, so no removal is undone by
    them.
    """
    why = {**old, **new}
    for key, reason in old.items():
        if reason in GONE and (stale or why[key] not in GONE):
            why[key] = reason
    gone = {key for key, reason in new.items() if reason in GONE}
    if stale:
        gone |= {key for key, reason in old.items() if reason in GONE}
    return why, gone


def _declared(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    """With the columns of this version: what the tables lack is null."""
    columns = [
        rows[field.name].cast(field.type)
        if field.name in rows.column_names
        else pa.nulls(rows.num_rows, field.type)
        for field in schema
    ]
    return pa.table(columns, names=schema.names)


def _are_whole(out: Path, counts: Mapping[str, int]) -> bool:
    """Whether the tables below `out` are all there, with so many rows."""
    try:
        for name in NAMES:
            parts = parquet_files(out / name)
            if not parts or sum(pq.read_metadata(path).num_rows for path in parts) != counts[name]:
                return False
        return pq.read_metadata(out / MISSING).num_rows == counts[MISSING]
    except (OSError, ValueError, KeyError):
        return False
