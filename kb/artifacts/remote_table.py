"""A table of a release that is read at an address."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import pyarrow as pa
import pyarrow.parquet as pq

from kb.artifacts.release_folder import TOMBSTONES, parse_tombstones
from kb.core.cached_property import cached_property
from kb.core.installation import ds
from kb.schema.conformity import column_problems, value_problem
from kb.schema.tables import Table
from kb.store.damage import unreadable
from kb.store.tables.parquet import released_table
from kb.store.tables.remote_files import RemoteFolder, reading_at

_THREADS = 8  # that ask for footers: most of their time is the way to the address
_TAIL = 1 << 14  # bytes at the end of a file, of which most footers need no more


@dataclass(frozen=True, eq=False)
class RemoteTable:
    """The shards of a table, or a folder's tombstones."""

    folder: RemoteFolder
    names: Sequence[str]
    _checked: list[bool] = field(default_factory=list)

    @cached_property
    def dataset(self) -> ds.Dataset:
        """All rows, read when they are asked for. Raises DamagedData as `check`, FatalError."""
        if TOMBSTONES in self.names:
            rows = self.folder.read_file(TOMBSTONES)
            return ds.dataset(parse_tombstones(rows, f"{self.folder}/{TOMBSTONES}"))
        self.verify_footers()
        return self.folder.dataset(self.names)

    def verify_footers(self) -> None:
        """Raises DamagedData where the footer of a shard says that columns or numbers are not as
        declared; to read all numbers would be to download the release.
        """
        if not self._checked and TOMBSTONES not in self.names:
            with ThreadPoolExecutor(_THREADS) as pool:
                for name, footer in zip(
                    self.names, pool.map(self._footer, self.names), strict=True
                ):
                    if (declared := released_table(name)) is not None:
                        _check(f"{self.folder}/{name}", declared, footer)
            self._checked.append(True)

    def _footer(self, name: str) -> pq.FileMetaData:
        """The footer of a shard, of which no more than that is read."""
        size = self.folder.sizes[name]
        with self.folder.open(name) as file, reading_at(f"{self.folder}/{name}"):
            file.seek(max(0, size - _TAIL))
            tail = file.read()
            length = int.from_bytes(tail[-8:-4], "little") + 8
            if len(tail) < length <= size:
                file.seek(size - length)
                tail = file.read()
            return pq.read_metadata(pa.BufferReader(tail))


def _check(place: str, declared: Table, footer: pq.FileMetaData) -> None:
    hint = "publish it again"
    for _, what in column_problems(declared, footer.schema.to_arrow_schema(), released=True):
        raise unreadable(place, what, hint)
    numbers = {
        column.name: column for column in declared.columns if column.released and column.range
    }
    for group in map(footer.row_group, range(footer.num_row_groups)):
        for chunk in map(group.column, range(group.num_columns)):
            known, column = chunk.statistics, numbers.get(chunk.path_in_schema)
            if column is None or known is None or not known.has_min_max:
                continue
            if what := value_problem(column, pa.array([known.min, known.max])):
                raise unreadable(place, what, hint)
