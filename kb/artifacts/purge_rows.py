"""Remove rows of purged keys from the files of tables, or count them.

A file is written again without the rows, one batch at a time, with the same order and settings.
Files without such rows are not touched.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial, reduce
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import default_workers
from kb.core.engine import make_threads
from kb.schema.tables import tables
from kb.store.layout import BELOW, Layout, parquet_files, rows_pattern
from kb.store.tables import parquet
from kb.store.tables.columns import with_nulls
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import ShardWriter

IsKept = Callable[[pa.RecordBatch], "pa.Array[Any]"]


class RowLocation(NamedTuple):
    """Where rows of keys are: a folder below the data root, the table, and the key's column.

    `prefix` is what the ids of the column lack where keys are full names (a comment may have the
    bare id of a post). With `source`, only rows count whose column of that name has this value: an
    id of one source may be an id of another one too.
    """

    folder: str
    table: str
    column: str
    prefix: str = ""
    source: str = ""

    def files(self, root: Path) -> list[Path]:
        """The table's files in the folder; release folders hold several tables."""
        flat = Path(self.folder).is_relative_to(BELOW.release())
        patterns = (
            [f"{stem}-*.parquet" for stem in tables()[self.table].stems]
            if flat
            else [rows_pattern(self.table)]
        )
        return [file for one in patterns for file in parquet_files(root / self.folder, one)]

    def values(self, keys: Collection[str]) -> pa.Array[Any]:
        """What the column contains for these keys."""
        mine = (key.removeprefix(self.prefix) for key in keys if key.startswith(self.prefix))
        return pa.array(sorted(mine), pa.string())

    def matches(self, rows: pa.RecordBatch, values: pa.Array[Any]) -> pa.Array[Any]:
        """A mask of the rows with one of the values."""
        mask = pc.is_in(rows.column(self.column).cast(pa.string()), value_set=values)
        if self.source:
            mask = pc.and_(mask, pc.equal(rows.column("source").cast(pa.string()), self.source))
        return cast("pa.Array[Any]", mask)

    @property
    def columns(self) -> list[str]:
        """The columns that `matches` reads."""
        return [self.column, *(["source"] if self.source else [])]


def location_of(table: str, column: str, prefix: str = "") -> RowLocation:
    """Where a data root keeps a declared table: "youtube/videos", "pairs/pairs"."""
    return RowLocation(str(BELOW.table(table)), table, column, prefix)


def shared_locations(source: str) -> tuple[RowLocation, ...]:
    """Rows about items of a source in tables that all sources have: verdicts, links, missing."""
    return (
        *(
            RowLocation(str(BELOW.clean(source, verdict)), f"shared/{verdict}", "key")
            for verdict in ("rejected", "failed", "pending")
        ),
        RowLocation(str(BELOW.links), "links/links", "key", source=source),
        RowLocation(str(BELOW.restored()), "shared/missing", "key"),
    )


def released(locations: Iterable[RowLocation]) -> Iterator[RowLocation]:
    """The same tables in release/."""
    for location in locations:
        if location.folder == str(BELOW.table(location.table)):
            source = location.table.partition("/")[0]
            yield location._replace(folder=str(BELOW.release(source)))


def drop_rows(
    root: Path, locations: Iterable[RowLocation], keys: Collection[str], *, dry: bool = False
) -> Iterator[tuple[str, str, int]]:
    """(folder, table, rows removed) of each table; with `dry` the rows are only counted.

    Raises DamagedData, DiskFull.
    """
    by_table = sorted(
        dict.fromkeys(locations), key=lambda location: (location.folder, location.table)
    )
    values = {location.prefix: location.values(keys) for location in by_table}
    # Reading and compressing release the interpreter lock.
    with make_threads(default_workers()) as pool:
        for (folder, table), group in groupby(
            by_table, key=lambda location: (location.folder, location.table)
        ):
            same = tuple(group)  # a table may name keys in several columns
            columns = list(dict.fromkeys(name for location in same for name in location.columns))

            def is_kept(rows: pa.RecordBatch, same: Any = same) -> pa.Array[Any]:
                masks = [location.matches(rows, values[location.prefix]) for location in same]
                return cast("pa.Array[Any]", pc.invert(reduce(pc.or_, masks)))

            drop = partial(keep_rows, table=table, columns=columns, is_kept=is_kept, dry=dry)
            yield folder, table, sum(pool.map(drop, same[0].files(root)))


def keys_in_rows(root: Path, locations: Iterable[RowLocation], keys: Collection[str]) -> set[str]:
    """Those of the keys that a row of these tables has. Raises DamagedData."""
    present: set[str] = set()
    for location in dict.fromkeys(locations):
        values = location.values(keys)
        for path in location.files(root) if len(values) else ():
            with reading([path]), parquet.open_file(path) as file:
                for batch in file.iter_batches(columns=location.columns):
                    rows = batch.filter(location.matches(batch, values))
                    names = pc.unique(rows.column(location.column).cast(pa.string()))
                    present.update(f"{location.prefix}{name}" for name in names.to_pylist())
    return present


def drop_annotations(root: Path, source: str, used: pa.Array[Any] | pa.ChunkedArray[Any]) -> int:
    """Remove scores of texts whose hash is not in `used`, as no row has them any more."""

    def is_kept(rows: pa.RecordBatch) -> pa.Array[Any]:
        return cast("pa.Array[Any]", pc.is_in(rows.column(0).cast(pa.string()), value_set=used))

    files = parquet_files(Layout(root).annotations(source))
    return sum(keep_rows(path, "shared/annotations", ["text_hash"], is_kept) for path in files)


def keep_rows(
    path: Path, table: str, columns: list[str], is_kept: IsKept, *, dry: bool = False
) -> int:
    """Keep the rows of a file that `is_kept` selects by these columns; how many are removed.

    With `dry` the file stays. Raises DamagedData for a file that can't be read.
    """
    with reading([path]), parquet.open_file(path) as file:
        masks = [is_kept(batch) for batch in file.iter_batches(columns=columns)]
        removed = int(file.metadata.num_rows - sum(pc.sum(mask).as_py() or 0 for mask in masks))
        if removed and not dry:
            mask, start = pa.chunked_array(masks, pa.bool_()).combine_chunks(), 0
            declared = tables()[table]
            is_released = file.schema_arrow.names == declared.names(released=True)
            schema = declared.arrow(is_released)
            with ShardWriter(path, table, released=is_released, in_order=True) as writer:
                for batch in file.iter_batches():
                    rows = batch.filter(mask.slice(start, batch.num_rows))
                    writer.add_rows(with_nulls(pa.Table.from_batches([rows]), schema))
                    start += batch.num_rows
    return removed
