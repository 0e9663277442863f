"""The figures of a release folder, as its card, datasheet and metadata tell them."""

from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from kb.schema import Column, Table
from kb.store.tables.reading import SANDBOX_MODEL


@dataclass(frozen=True, slots=True)
class ColumnFacts:
    """One column: `low`, `middle` (median) and `high` of numbers and times,
    `top` values of categories.
    """

    column: Column
    nulls: int
    low: Any = None
    middle: Any = None
    high: Any = None
    top: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class DataFile:
    """A data file: bytes, rows (None when it is no table) and SHA-256."""

    name: str
    size: int
    rows: int | None
    sha256: str


@dataclass(frozen=True, slots=True)
class TableFacts:
    """One table of the folder."""

    table: Table
    rows: int
    files: tuple[DataFile, ...]
    columns: tuple[ColumnFacts, ...]

    @property
    def size(self) -> int:
        """Bytes of all shards."""
        return sum(file.size for file in self.files)


@dataclass(frozen=True, slots=True)
class Facts:
    """All of a folder. `rejected` is (stage, reason) → rows; `spans` are dates of the material
    itself.

    `gaps` are sentences on what these very rows lack.
    """

    source: str
    built: datetime
    tables: tuple[TableFacts, ...]
    others: tuple[DataFile, ...]
    licence: str
    licences: tuple[tuple[str, int], ...]
    read: tuple[datetime, datetime] | None
    made: tuple[datetime, datetime] | None
    rejected: tuple[tuple[str, str, int], ...]
    failed: int
    pending: int
    models: tuple[tuple[str, str, str], ...]
    tombstones: int
    personal: dict[tuple[str, str], tuple[int, int, int]] = field(default_factory=dict)
    gaps: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Rows of all tables."""
        return sum(table.rows for table in self.tables)

    @property
    def size(self) -> int:
        """Bytes of all data files."""
        return sum(table.size for table in self.tables) + sum(file.size for file in self.others)

    @property
    def sandbox(self) -> bool:
        """Whether the sandbox's tiny model scored any of it."""
        return any(model == SANDBOX_MODEL for model, _, _ in self.models)
