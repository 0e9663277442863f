"""A table of a release that is read at an address."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kb.artifacts.release_folder import TOMBSTONES, parse_tombstones
from kb.core.cached_property import cached_property
from kb.core.installation import ds
from kb.store.tables.remote_files import RemoteFolder


@dataclass(frozen=True, eq=False)
class RemoteTable:
    """The shards of a table, or a folder's tombstones."""

    folder: RemoteFolder
    names: Sequence[str]

    @cached_property
    def dataset(self) -> ds.Dataset:
        """All rows, read when they are asked for. Raises DamagedData, FatalError."""
        if TOMBSTONES in self.names:
            rows = self.folder.read(TOMBSTONES)
            return ds.dataset(parse_tombstones(rows, f"{self.folder}/{TOMBSTONES}"))
        return self.folder.dataset(self.names)
