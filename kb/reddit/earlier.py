"""What earlier runs of `kb reddit reconstruct` brought into a folder, and how a new run adds to it.

By id the newest answer wins. What Reddit now says is gone leaves the tables; what only could not be
had this time (failed, forbidden, malformed, not in these dumps) leaves the older row as it is. A
removal is undone by what was read later alone: never by an older dump, nor by one that does not
say when it was read.

    out/.done.json     which lists of ids were answered whole, and how many rows the tables have
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, cast

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
FOREVER = datetime(9999, 1, 1, tzinfo=UTC)  # when what nobody can undo was said
_SINCE = "writes"  # in a work folder: how often the tables had been written when it began
_ROWS = 65_536


class MissingReason(NamedTuple):
    """Why something is in no table; `at`: when the source said so, None where it did not say."""

    reason: str
    at: datetime | None = None

    @property
    def gone(self) -> bool:
        """Whether it is a last word."""
        return self.reason in GONE


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
    """What is done in `out`; where tables are not whole, nothing is."""
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


def missing(out: Path) -> dict[str, MissingReason]:
    """Key → why, of what earlier runs did not get. Raises DamagedData."""
    path = out / MISSING
    if not path.exists():
        return {}
    with reading([path]):
        rows = parquet.read_table(path)
    keys, reasons = (cast("list[str]", rows[name].to_pylist()) for name in ("key", "reason"))
    times: list[Any] = rows["said_at"].to_pylist()
    return {key: MissingReason(*rest) for key, *rest in zip(keys, reasons, times, strict=True)}


def spread(out: Path, folder: Path, buckets: int) -> None:
    """Rows of the tables → `folder/<bucket>/old-<name>.arrow`, by post. Raises DamagedData,
    DiskFull.
    """
    for name in NAMES:
        parts = parquet_files(out / name)
        with Shuffle(folder, f"old-{name}", buckets) as shuffle, reading(parts):
            for path in parts:
                for batch in parquet.open_file(path).iter_batches(_ROWS):
                    rows = pa.Table.from_batches([batch])
                    shuffle.write(rows, rows["post_id"])


class Verdicts(NamedTuple):
    """What the last words are about: full names, and the time of each.

    `old` ones leave fresh rows alone when this run's answers are `newer` than all that is in the
    tables; `new` ones then take out every row.
    """

    old: pa.Table
    new: pa.Table
    newer: bool


def verdicts(
    old: Mapping[str, MissingReason], new: Mapping[str, MissingReason], *, newer: bool
) -> Verdicts:
    """Of what earlier runs and this one did not get."""
    return Verdicts(_last_words(old.items()), _last_words(new.items()), newer)


def _last_words(lost: Iterable[tuple[str, MissingReason]]) -> pa.Table:
    rows = [(key, one.at) for key, one in lost if one.gone]
    times = pa.array([at for _, at in rows], pa.timestamp("us", "UTC"))
    return pa.table({"key": pa.array([key for key, _ in rows], pa.string()), "at": times})


def merged(name: str, number: int, folder: Path, fresh: pa.Table, said: Verdicts) -> pa.Table:
    """The rows of a bucket: `fresh` ones and what `spread` put there, by id the one that was read
    last, without what a later last word is about.
    """
    path, key = folder / str(number) / f"old-{name}.arrow", table(f"reddit/{name}").key[0]
    prefix = "t3_" if name == "posts" else "t1_"
    if not said.newer:
        fresh = _without(fresh, key, prefix, said.old, whenever=False)
    parts = [fresh]
    if path.exists():
        with pa.ipc.open_file(str(path)) as file:
            old = file.read_all().select(fresh.column_names).cast(fresh.schema)
        parts.insert(0, _without(old, key, prefix, said.new, whenever=said.newer))
    return newest(pa.concat_tables(parts), [key], ["fetched_at"])


def _without(rows: pa.Table, key: str, prefix: str, said: pa.Table, *, whenever: bool) -> pa.Table:
    """The rows that no last word is about; or, not `whenever`, that were read after it."""
    of = said.filter(pc.starts_with(said["key"], prefix))
    bare = pc.utf8_slice_codeunits(of["key"], len(prefix)).combine_chunks()
    place = pc.index_in(rows[key], value_set=bare)
    left = pc.is_null(place)
    if not whenever:
        later = pc.greater(rows["fetched_at"], of["at"].combine_chunks().take(place))
        left = pc.or_(left, pc.fill_null(later, False))
    return rows.filter(left)


def deep(comments: pa.Table) -> pa.Table:
    """Depths that no run knew by itself, from the comments of all of them."""
    keys = cast("list[str]", comments["comment_id"].to_pylist())
    known = depths(zip(keys, comments["parent_id"].to_pylist(), strict=True))
    found = pa.array([known.get(key) for key in keys], pa.int64())
    place = comments.column_names.index("depth")
    return comments.set_column(place, "depth", pc.coalesce(comments["depth"], found))


def reasons(
    old: Mapping[str, MissingReason], new: Mapping[str, MissingReason], *, newer: bool
) -> dict[str, MissingReason]:
    """Why things are missing after both. `newer` as in `Verdicts`: else the later word counts."""
    why = {**old, **new}
    for key, before in old.items():
        now = why[key]
        if before.gone and not (now.gone and (newer or _is_later(now, before))):
            why[key] = before
    return why


def _is_later(one: MissingReason, other: MissingReason) -> bool:
    return one.at is not None and (other.at is None or one.at > other.at)


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
