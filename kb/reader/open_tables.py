"""The tables of one or more folders, with one connection over them."""

import weakref
from collections.abc import Iterable, Sequence
from typing import Any

import duckdb
import pyarrow as pa

from kb import query
from kb.artifacts.table_catalog import SCHEMAS, Catalog, View, check_once
from kb.query.remote_duckdb import reading_views
from kb.store.tables import parquet
from kb.store.tables.reading import reading


class OpenTables:
    """Tables by their full names; DuckDB is opened for the first query. `remote`: tables that are
    read at an address.

    Raises UsageError if two of the folders contain the same table.
    """

    def __init__(self, catalogs: Sequence[Catalog], remote: Iterable[View] = ()) -> None:
        self.catalogs = catalogs
        self.named: dict[str, View] = {}
        for view in [*(view for one in catalogs for view in one.views), *remote]:
            check_once(self.named, view)
        self.views = [*self.named.values()]
        self._con: duckdb.DuckDBPyConnection | None = None

    @property
    def con(self) -> duckdb.DuckDBPyConnection:
        """The connection, with a view for each table."""
        if self._con is None:
            self._con = query.connect(None, self.views)
            # Its threads call Python to read at an address, and must not do so while Python exits.
            weakref.finalize(self, self._con.close)
        return self._con

    def __contains__(self, full: str) -> bool:
        return full in self.named

    def ranked(self, short: str) -> list[View]:
        """The tables of one name, fullest first: clean, release, restored."""
        full = [f"{schema}.{short}" for schema in SCHEMAS]
        return [self.named[name] for name in full if name in self.named]

    def rows(self, sql: str, parameters: Sequence[Any] = ()) -> pa.Table:
        """The rows of a query, with values for its question marks."""
        used = [view for view in self.views if view.name in sql]
        files = [path for view in used for path in view.files]
        with reading(files), reading_views(used):
            parquet.check(*files)
            return self.con.sql(sql, params=list(parameters)).to_arrow_table()

    def folders(self) -> list[str]:
        return sorted({str(one.home) for one in self.views})
