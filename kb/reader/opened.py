"""The views that were found and one connection over them: what pages, threads and clips ask."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import duckdb
import pyarrow as pa

from kb import query
from kb.query.views import SCHEMAS
from kb.reader.places import Placed
from kb.store import parquet
from kb.store.reading import reading


class Opened:
    """Tables by their full names; DuckDB is opened at the first question."""

    def __init__(self, placed: dict[str, Placed]) -> None:
        self.placed = placed
        self.views = [one.view for one in placed.values()]
        self._con: duckdb.DuckDBPyConnection | None = None

    @property
    def con(self) -> duckdb.DuckDBPyConnection:
        """The connection, with a view for each table."""
        if self._con is None:
            self._con = query.connect(None, self.views)
        return self._con

    def __contains__(self, full: str) -> bool:
        return full in self.placed

    def ranked(self, short: str) -> list[Placed]:
        """The tables of one name, the fullest first: clean, release, restored."""
        full = [f"{schema}.{short}" for schema in SCHEMAS]
        return [self.placed[name] for name in full if name in self.placed]

    def rows(self, sql: str, parameters: Sequence[Any] = ()) -> pa.Table:
        """The rows of a query of our own, with values for its question marks."""
        files = [path for view in self.views if view.name in sql for path in view.files]
        with reading(files):
            parquet.check(*files)
            table: pa.Table = self.con.sql(sql, params=list(parameters)).to_arrow_table()
            return table

    def folders(self) -> list[str]:
        """The folders that the tables were found in."""
        return sorted({str(one.home) for one in self.placed.values()})
