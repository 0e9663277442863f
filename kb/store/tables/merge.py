"""One sorted stream out of many sorted Parquet files, in bounded memory.

Every file is read a small batch ahead. What is smaller than the smallest last value of all
batches can't be preceded by anything unread, so it is cut off every batch, sorted together and
handed out: a few Arrow calls for about a row group of rows. Files that are not marked as sorted
the right way are sorted first, one at a time (each was written from memory once).
"""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

from kb.core.installation import pc
from kb.store.tables import parquet
from kb.store.tables.reading import reading

ROWS_AHEAD = 16_384  # rows that all files together are read ahead
_LEAST = 64  # the part of them that a file is read ahead, however many files there are


class Merge:
    """Iterates tables of `columns` in the order of `by`; the first of `by` is never null.

    `ahead` are the rows that all files together are read ahead: few where rows are large.
    `scratch`: the folder in which unsorted files are sorted, by default their own. Raises
    DamagedData for a file that can't be read. `close()` closes the files.
    """

    def __init__(
        self,
        parts: Sequence[Path],
        by: Sequence[str],
        columns: Sequence[str],
        ahead: int | None = None,
        scratch: Path | None = None,
    ) -> None:
        ahead = ahead or ROWS_AHEAD
        self._ahead = max(1, ahead // _LEAST, ahead // max(1, len(parts)))
        self._by: list[tuple[str, Literal["ascending", "descending"]]] = [
            (name, "ascending") for name in by
        ]
        self._first = by[0]
        self._columns = [*columns, *(name for name in by if name not in columns)]
        self._wanted = list(columns)
        self._parts = parts
        self._cursors: list[_Cursor] = []
        self._place = scratch
        self._scratch: str | None = None

    def __iter__(self) -> Iterator[pa.Table]:
        with reading(self._parts):
            yield from self._tables()

    def _tables(self) -> Iterator[pa.Table]:
        ahead = self._ahead
        self._cursors = [_Cursor(self._sorted(path), self._columns, ahead) for path in self._parts]
        live = [cursor for cursor in self._cursors if cursor.fill(ahead)]
        while live:
            bound = min(
                (cursor.last(self._first) for cursor in live if not cursor.ended), default=None
            )
            heads = [head for cursor in live if (head := cursor.cut(self._first, bound)).num_rows]
            if heads:
                yield pa.concat_tables(heads).sort_by(self._by).select(self._wanted)
            else:  # more rows share the bound than were read ahead
                for cursor in live:
                    if not cursor.ended and cursor.last(self._first) == bound:
                        cursor.more()
            live = [cursor for cursor in live if cursor.fill(ahead)]

    def close(self) -> None:
        """Close the files and remove what was sorted beside them."""
        for cursor in self._cursors:
            cursor.close()
        if self._scratch:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def _sorted(self, path: Path) -> Path:
        if _is_sorted(path, [name for name, _ in self._by]):
            return path
        if self._scratch is None:
            self._scratch = tempfile.mkdtemp(prefix=".sort-", dir=self._place or path.parent)
        copy = Path(self._scratch, f"{len(self._cursors)}-{path.name}")
        rows = parquet.read_table(path, columns=self._columns).sort_by(self._by)
        parquet.write_file(copy, rows)
        return copy


def _is_sorted(path: Path, by: list[str]) -> bool:
    """Whether the file says that each of its row groups, and they one after another,
    are in this order.
    """
    file = parquet.footer(path)
    names = [file.schema.column(index).path for index in range(file.num_columns)]
    for index in range(file.num_row_groups):
        marks = file.row_group(index).sorting_columns
        bounds = [
            names[mark.column_index]
            for mark in marks
            if not mark.descending and not mark.nulls_first
        ]
        if bounds[: len(by)] != by:
            return False
    return True


class _Cursor:
    """One file: the rows read ahead and not yet handed out."""

    def __init__(self, path: Path, columns: list[str], batch: int) -> None:
        self._file = parquet.open_file(path, pre_buffer=False, buffer_size=1 << 16)
        self._batches = self._file.iter_batches(
            batch_size=batch, columns=columns, use_threads=False
        )
        self._columns = columns
        self.rows: Any = None  # a table, once a batch was read
        self.ended = False

    def fill(self, least: int) -> bool:
        """Read until `least` rows are ahead or the file ends; whether any row is left."""
        while not self.ended and (self.rows is None or self.rows.num_rows < least):
            self.more()
        return self.rows is not None and self.rows.num_rows > 0

    def more(self) -> None:
        """Read one batch."""
        batch = next(self._batches, None)
        if batch is None:
            self.ended = True
            return
        rows = pa.Table.from_batches([batch]).select(self._columns)
        self.rows = (
            rows
            if self.rows is None or not self.rows.num_rows
            else pa.concat_tables([self.rows, rows])
        )

    def last(self, name: str) -> Any:
        """The last value that was read."""
        return self.rows.column(name)[-1].as_py()

    def cut(self, name: str, bound: Any) -> pa.Table:
        """Cut off the rows below `bound` (all when it is None)."""
        if bound is None:
            count = self.rows.num_rows
        else:
            values = self.rows.column(name)
            count = pc.sum(pc.less(values, pa.scalar(bound, values.type))).as_py() or 0
        head: pa.Table = self.rows.slice(0, count)
        self.rows = self.rows.slice(count)
        return head

    def close(self) -> None:
        self._file.close()


class RowsByKey:
    """Rows of a second table in the order of `key`, read along with the rows of a first one."""

    def __init__(self, rows: Iterator[dict[str, Any]], key: str) -> None:
        self._rows, self._key = rows, key
        self._next = next(rows, None)

    def rows_of(self, key: Any) -> Iterator[dict[str, Any]]:
        """The rows of one key; ask for keys in rising order, and read them before the next."""
        while self._next is not None and self._next[self._key] < key:
            self._next = next(self._rows, None)
        while self._next is not None and self._next[self._key] == key:
            yield self._next
            self._next = next(self._rows, None)
