"""The one place that writes Parquet.

Settings as measured best on 10 M comment rows: zstd 3 (zstd 1 for tables that are never released),
row groups of 131,072 rows, statistics and page index, dictionaries on the columns that `schemas/`
marks as low-cardinality and on no other, sorted by the table's `sort_by`. Every file appears whole
or not at all.

Bytes depend on the rows alone: each row group is written from one contiguous block, so page
boundaries can't follow from how the rows arrived, and nothing in the file tells the time.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import pyarrow as pa
import pyarrow.parquet as pq

from kb.core.installation import pc
from kb.schema.tables import Table, conform, table
from kb.store.atomic import writing
from kb.store.tables import parquet
from kb.store.tables.merge import Merge

ROW_GROUP = 131_072  # rows
SHARD = 256_000_000  # bytes after which a shard ends; row groups are whole
RELEASED, INTERNAL = 3, 1  # levels of zstd
PAGE = 128 << 10  # bytes: small pages keep a merge of many files small, and a look-up cheap


class Shard(NamedTuple):
    """A written file and its rows."""

    path: Path
    rows: int


def order(declared: Table) -> list[str]:
    """A total order: `sort_by`, then what of the key is not in it."""
    return [*declared.sort_by, *(name for name in declared.key if name not in declared.sort_by)]


def write_table(
    path: Path,
    rows: pa.Table,
    declared: Table | str,
    *,
    released: bool = False,
    sync: bool = True,
) -> Shard:
    """Write `rows` as one sorted file; `sync` as in kb.store.atomic.

    Raises SchemaMismatch and DiskFull.
    """
    declared = table(declared) if isinstance(declared, str) else declared
    rows = conform(declared, rows, released=released)
    if not _sorted(rows, order(declared)):
        rows = rows.sort_by([(name, "ascending") for name in order(declared)])
    with ShardWriter(path, declared, released=released, in_order=True, sync=sync) as writer:
        writer.add_rows(rows)
    return Shard(path, rows.num_rows)


def _sorted(rows: pa.Table, names: list[str]) -> bool:
    """Whether rows stand in their order already, so that none has to be copied; False where several
    columns decide.
    """
    if rows.num_rows < 2:
        return True
    column = rows.column(names[0])
    if len(names) > 1 or column.null_count or pa.types.is_dictionary(column.type):
        return False
    values = column.combine_chunks()
    last = len(values) - 1
    return bool(pc.all(pc.less_equal(values.slice(0, last), values.slice(1))).as_py())


class ShardWriter:
    """Writes one Parquet file from tables of any size, in exact row groups.

    A context manager: the file appears at `path` when the block ends well, not at all otherwise.
    At most one row group and one given table are held in memory. `in_order` is the caller's word
    that rows come in the table's order, and is written into the file.
    """

    def __init__(
        self,
        path: Path,
        declared: Table | str,
        *,
        released: bool = False,
        in_order: bool = False,
        sync: bool = True,
        group_rows: int = ROW_GROUP,
    ) -> None:
        self.declared = table(declared) if isinstance(declared, str) else declared
        self.path, self.released, self.rows = path, released, 0
        self._group_rows = group_rows
        self._schema = self.declared.arrow(released)
        self._waiting: list[pa.Table] = []
        self._held = 0
        self._in_order, self._sync = in_order, sync

    def __enter__(self) -> Self:
        declared, schema = self.declared, self._schema
        low = [
            column.name
            for column in declared.columns
            if column.dictionary and column.name in schema.names
        ]
        marks = pq.SortingColumn.from_ordering(
            schema, [(name, "ascending") for name in order(declared)], "at_end"
        )
        self._stack = contextlib.ExitStack()
        self._temporary = self._stack.enter_context(writing(self.path, sync=self._sync))
        self._file = self._stack.enter_context(
            parquet.writing(
                self._temporary,
                schema,
                version="2.6",
                compression_level=RELEASED if declared.released else INTERNAL,
                use_dictionary=low or False,
                data_page_size=PAGE,
                write_statistics=True,
                write_page_index=True,
                sorting_columns=marks if self._in_order else None,
            )
        )
        return self

    @property
    def size(self) -> int:
        """Bytes of the row groups written so far."""
        return self._temporary.stat().st_size

    def add_rows(self, rows: pa.Table) -> None:
        """Add rows in their order. Raises SchemaMismatch."""
        rows = conform(self.declared, rows, released=self.released)
        self.rows += rows.num_rows
        while rows.num_rows:
            part = rows.slice(0, self._group_rows - self._held)
            rows = rows.slice(part.num_rows)
            self._waiting.append(part)
            self._held += part.num_rows
            if self._held == self._group_rows:
                self._flush()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        failure: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._flush()
        except BaseException as error:
            self._stack.__exit__(type(error), error, error.__traceback__)
            raise
        self._stack.__exit__(kind, failure, trace)

    def _flush(self) -> None:
        if self._held:
            group = pa.concat_tables(self._waiting).combine_chunks()
            self._waiting, self._held = [], 0
            self._file.write_table(group, row_group_size=self._group_rows)


def sorted_shards(
    parts: Sequence[Path],
    folder: Path,
    declared: Table | str,
    *,
    shard_bytes: float = SHARD,
    group_rows: int = ROW_GROUP,
    released: bool = True,
    reads: Sequence[str] = (),
    change: Callable[[pa.Table], pa.Table] | None = None,
) -> list[Shard]:
    """Merge many part files into globally sorted `<table>-00000-of-0000N.parquet` in `folder`,
    a fresh one that `replacing_folder` syncs. A shard ends with the row group that reaches
    `shard_bytes`.

    `change` derives columns of a piece of rows, from the declared ones and the clean columns in
    `reads`. The same rows give the same bytes, whatever the parts. Memory is bounded by two row
    groups and a page of each part's columns. Without rows one empty shard is written, so that
    readers find the table. Raises DamagedData, SchemaMismatch and DiskFull.
    """
    declared = table(declared) if isinstance(declared, str) else declared
    wanted = [
        *declared.names(released),
        *(name for name in reads if name not in declared.names(released)),
    ]
    with contextlib.closing(Merge(parts, order(declared), wanted)) as merge:
        rows = (
            change(batch).select(declared.names(released)) if change else batch for batch in merge
        )
        return write_sorted(
            rows,
            folder,
            declared,
            shard_bytes=shard_bytes,
            group_rows=group_rows,
            released=released,
        )


def write_sorted(
    rows: Iterator[pa.Table],
    folder: Path,
    declared: Table | str,
    *,
    shard_bytes: float = SHARD,
    group_rows: int = ROW_GROUP,
    released: bool = True,
    stem: str = "",
) -> list[Shard]:
    """Write rows that come in the table's order as `sorted_shards` does. The files' names begin
    with `stem` where it is given. Raises SchemaMismatch and DiskFull.
    """
    declared = table(declared) if isinstance(declared, str) else declared
    stem = stem or declared.short
    written: list[Shard] = []
    groups = _in_groups(rows, group_rows)
    group = next(groups, None)
    while group is not None or not written:
        path = folder / f".{stem}-{len(written):05d}.parquet"
        with ShardWriter(
            path,
            declared,
            released=released,
            in_order=True,
            sync=False,
            group_rows=group_rows,
        ) as writer:
            while group is not None and (not writer.rows or writer.size < shard_bytes):
                writer.add_rows(group)
                group = next(groups, None)
        written.append(Shard(path, writer.rows))
    number = len(written)  # which the name of each shard says
    return [
        Shard(path.rename(folder / f"{stem}-{at:05d}-of-{number:05d}.parquet"), count)
        for at, (path, count) in enumerate(written)
    ]


def _in_groups(tables: Iterator[pa.Table], size: int) -> Iterator[pa.Table]:
    """The rows of a stream in tables of `size` rows; the last one may have fewer."""
    waiting: list[pa.Table] = []
    count = 0
    for table_ in tables:
        rows = table_
        while rows.num_rows:
            waiting.append(rows.slice(0, size - count))
            rows = rows.slice(size - count)
            count += waiting[-1].num_rows
            if count == size:
                yield pa.concat_tables(waiting)
                waiting, count = [], 0
    if count:
        yield pa.concat_tables(waiting)
