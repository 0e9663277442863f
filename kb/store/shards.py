"""The one place that writes Parquet.

Settings as measured best on 10 M comment rows: zstd 3, row groups of 131,072 rows, statistics and
page index, dictionaries on the columns that `schemas/` marks as low-cardinality and on no other,
sorted by the table's `sort_by`. Every file appears whole or not at all.

Bytes depend on the rows alone: each row group is written from one contiguous block, so page
boundaries can't follow from how the rows arrived, and nothing in the file tells the time.
"""

from __future__ import annotations

import contextlib
import shutil
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from kb.core.errors import DiskFull
from kb.schema.conform import conform
from kb.schema.tables import Table, table
from kb.store.atomic import writing

if TYPE_CHECKING:
    import pyarrow as pa

ROW_GROUP = 131_072
ZSTD_LEVEL = 3
SORT_MEMORY = "512MB"  # what the external sort may hold before it spills


class Shard(NamedTuple):
    """A written file and its rows."""

    path: Path
    rows: int


def order(declared: Table) -> list[str]:
    """A total order: `sort_by`, then what of the key is not in it."""
    return [*declared.sort_by, *(name for name in declared.key if name not in declared.sort_by)]


def write_table(path: Path, rows: pa.Table, declared: Table | str, *, released: bool = False, sort: bool = True) -> Shard:
    """Write `rows` as one sorted file. Raises SchemaMismatch and DiskFull."""
    declared = table(declared) if isinstance(declared, str) else declared
    rows = conform(declared, rows, released=released)
    if sort and rows.num_rows > 1:
        rows = rows.sort_by([(name, "ascending") for name in order(declared)])
    with ShardWriter(path, declared, released=released) as writer:
        writer.write(rows)
    return Shard(path, rows.num_rows)


class ShardWriter:
    """Writes one Parquet file from tables of any size, in exact row groups.

    A context manager: the file appears at `path` when the block ends well, not at all otherwise.
    At most one row group and one given table are held in memory.
    """

    def __init__(self, path: Path, declared: Table | str, *, released: bool = False) -> None:
        self.declared = table(declared) if isinstance(declared, str) else declared
        self.path, self.released, self.rows = path, released, 0
        self._schema = self.declared.arrow(released)
        self._waiting: list[pa.Table] = []
        self._held = 0

    def __enter__(self) -> ShardWriter:
        self._stack = contextlib.ExitStack()
        temporary = self._stack.enter_context(writing(self.path))
        self._file = self._stack.enter_context(open_writer(temporary, self.declared, self._schema))
        return self

    def write(self, rows: pa.Table) -> None:
        """Add rows in their order. Raises SchemaMismatch."""
        rows = conform(self.declared, rows, released=self.released)
        self.rows += rows.num_rows
        while rows.num_rows:
            part = rows.slice(0, ROW_GROUP - self._held)
            rows = rows.slice(part.num_rows)
            self._waiting.append(part)
            self._held += part.num_rows
            if self._held == ROW_GROUP:
                self._flush()

    def __exit__(self, *failure: Any) -> None:
        try:
            if failure[0] is None:
                self._flush()
        except BaseException as error:
            self._stack.__exit__(type(error), error, error.__traceback__)
            raise
        self._stack.__exit__(*failure)

    def _flush(self) -> None:
        import pyarrow as pa

        if self._held:
            group = pa.concat_tables(self._waiting).combine_chunks()
            self._waiting, self._held = [], 0
            self._file.write_table(group, row_group_size=ROW_GROUP)


def open_writer(path: Path, declared: Table, schema: pa.Schema) -> Any:
    """A pyarrow ParquetWriter with the project's settings."""
    import pyarrow.parquet as pq

    low = [column.name for column in declared.columns if column.dictionary and column.name in schema.names]
    known = [name for name in order(declared) if name in schema.names]
    return pq.ParquetWriter(
        path, schema, version="2.6", compression="zstd", compression_level=ZSTD_LEVEL,
        use_dictionary=low or False, write_statistics=True, write_page_index=True,
        sorting_columns=pq.SortingColumn.from_ordering(schema, [(name, "ascending") for name in known], "at_end"),
    )


def sorted_shards(
    parts: Sequence[Path], folder: Path, declared: Table | str, *, rows_per_shard: int, released: bool = True,
    columns: Mapping[str, str] | None = None, memory: str = SORT_MEMORY, threads: int | None = None,
) -> list[Shard]:
    """Sort the rows of many part files into `<table>-00000-of-0000N.parquet` in `folder`.

    `columns` gives SQL expressions for columns that differ from the parts' own. The sort spills to
    a folder beside `folder` when it outgrows `memory`, so memory doesn't grow with the rows. The
    same rows give the same bytes, whatever the parts, threads or memory. Without rows one empty
    shard is written, so that readers find the table. Raises SchemaMismatch and DiskFull.
    """
    import pyarrow.parquet as pq

    declared = table(declared) if isinstance(declared, str) else declared
    total = sum(pq.read_metadata(path).num_rows for path in parts)
    number = max(1, -(-total // rows_per_shard))
    batches = _sorted_batches(parts, folder, declared, released, columns or {}, memory, threads) if total else iter(())
    shards = []
    with contextlib.closing(_Feed(batches)) as feed:
        for index in range(number):
            path = folder / f"{declared.short}-{index:05d}-of-{number:05d}.parquet"
            with ShardWriter(path, declared, released=released) as writer:
                for rows in feed.take(rows_per_shard):
                    writer.write(rows)
            shards.append(Shard(path, writer.rows))
    return shards


class _Feed:
    """Hands out a stream of tables in pieces of a wanted number of rows."""

    def __init__(self, batches: Iterator[pa.Table]) -> None:
        self._batches, self._rest = batches, None

    def take(self, rows: int) -> Iterable[pa.Table]:
        while rows:
            part = self._rest if self._rest is not None else next(self._batches, None)
            if part is None:
                return
            self._rest = part.slice(rows) if part.num_rows > rows else None
            part = part.slice(0, rows)
            rows -= part.num_rows
            yield part

    def close(self) -> None:
        if hasattr(self._batches, "close"):
            self._batches.close()


def _sorted_batches(
    parts: Sequence[Path], folder: Path, declared: Table, released: bool, columns: Mapping[str, str],
    memory: str, threads: int | None,
) -> Iterator[pa.Table]:
    import duckdb
    import pyarrow as pa

    spill = folder.parent / f".{folder.name.lstrip('.')}.{uuid.uuid4().hex[:8]}.sort"
    wanted = ", ".join(f"{columns.get(name, quoted(name))} AS {quoted(name)}" for name in declared.names(released))
    by = ", ".join(f"{quoted(name)} ASC NULLS LAST" for name in order(declared))
    con = duckdb.connect()
    try:
        con.execute(f"SET memory_limit = '{memory}'")
        con.execute(f"SET temp_directory = {literal(spill)}")
        con.execute("SET TimeZone = 'UTC'")
        if threads:
            con.execute(f"SET threads = {int(threads)}")
        files = ", ".join(literal(path) for path in parts)
        query = f"SELECT {wanted} FROM read_parquet([{files}]) ORDER BY {by}"
        for batch in con.execute(query).to_arrow_reader(ROW_GROUP):
            yield pa.Table.from_batches([batch])
    except duckdb.Error as error:
        if "No space left on device" in str(error):  # DuckDB gives no code for it
            raise DiskFull(f"no room to sort {declared.name} in {spill.parent}", hint="free some space and run the same command again") from error
        raise
    finally:
        con.close()
        shutil.rmtree(spill, ignore_errors=True)


def quoted(name: str) -> str:
    """`name` as a SQL identifier."""
    return '"' + name.replace('"', '""') + '"'


def literal(value: object) -> str:
    """`value` as a SQL string."""
    return "'" + str(value).replace("'", "''") + "'"
