"""A table of a release that is read at an address."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from kb.artifacts.release_folder import TOMBSTONES, parse_tombstones
from kb.core.cached_property import cached_property
from kb.core.installation import ds
from kb.schema.conformity import column_problems, value_problem
from kb.schema.tables import Table
from kb.store.damage import unreadable
from kb.store.tables.parquet import released_table
from kb.store.tables.remote_files import RemoteFolder, reading_at


@dataclass(frozen=True, eq=False)
class RemoteTable:
    """The shards of a table, or a folder's tombstones."""

    folder: RemoteFolder
    names: Sequence[str]

    @cached_property
    def dataset(self) -> ds.Dataset:
        """All rows, read when they are asked for. Raises DamagedData, also where the footer of a
        shard says that columns or numbers are not as declared, FatalError.
        """
        if TOMBSTONES in self.names:
            rows = self.folder.read(TOMBSTONES)
            return ds.dataset(parse_tombstones(rows, f"{self.folder}/{TOMBSTONES}"))
        dataset = self.folder.dataset(self.names)
        for name, fragment in zip(self.names, dataset.get_fragments(), strict=True):
            place, declared = f"{self.folder}/{name}", released_table(name)
            if declared is not None:
                with reading_at(place):
                    _check(place, declared, fragment)
        return dataset


def _check(place: str, declared: Table, shard: ds.ParquetFileFragment) -> None:
    """Raises DamagedData. Numbers are compared as far as the footer knows them: to read all of them
    would be to download the release.
    """
    again = "publish it again"
    for _, what in column_problems(declared, shard.physical_schema, released=True):
        raise unreadable(place, what, again)
    numbers = {one.name: one for one in declared.columns if one.released and one.range}
    for group in shard.row_groups:
        for name, bounds in (group.statistics or {}).items():
            column = numbers.get(name)
            both = pa.array([bounds["min"], bounds["max"]])
            if column is not None and (what := value_problem(column, both)):
                raise unreadable(place, what, again)
