"""The tables of a data root or release as a page finds them.

The folder is listed anew for each page, so that a filter, export or purge that ran meanwhile shows
at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from kb.artifacts.table_catalog import Catalog, View, bare
from kb.core.errors import UsageError
from kb.query.views import connect
from kb.store.tables import parquet
from kb.store.tables.reading import reading


class CurrentTables:
    """The tables of a data root or release, by full and by bare name."""

    def __init__(self, root: Path) -> None:
        self.catalog = Catalog(root)
        views = self.catalog.views
        self._named = {view.full: view for view in views} | bare(views)

    def __contains__(self, name: str) -> bool:
        return name in self._named

    @property
    def names(self) -> list[str]:
        """The names of all tables, full and bare."""
        return [*self._named]

    def view(self, name: str) -> View:
        """A table by its name. Raises KeyError."""
        return self._named[name]

    def columns(self, name: str) -> frozenset[str]:
        """The columns of a table. Raises KeyError, DamagedData."""
        first = self.view(name).files[0]
        with reading([first]):
            return frozenset(parquet.names(first))

    def count(self, name: str) -> int:
        """The rows of a table, 0 of one that is not there. Raises DamagedData."""
        files = self.view(name).files if name in self else []
        with reading(files):
            return sum(parquet.footer(path).num_rows for path in files)

    @contextmanager
    def asked(self, *names: str) -> Iterator[duckdb.DuckDBPyConnection]:
        """A connection that reads these tables and nothing else. Raises DamagedData."""
        views = [self.view(name) for name in names]
        files = [path for view in views for path in view.files]
        with reading(files), connect(None, views) as con:
            for view in views:
                view.verify_files()
            yield con

    def rows(self, name: str, sql: str, parameters: Sequence[Any] = ()) -> pa.Table:
        """The result of a query over one table, which it calls {table}. Raises DamagedData."""
        with self.asked(name) as con:
            query = sql.format(table=self.view(name).full)
            return con.sql(query, params=list(parameters)).to_arrow_table()


def page_number(query: Mapping[str, str], last: int) -> int:
    """The page that an address asks for, from 1 to `last`. Raises UsageError for any other."""
    page = query.get("page", "1")
    if not page.isascii() or not page.isdigit() or not 1 <= int(page) <= last:
        raise UsageError(f"there is no page {page!r}")
    return int(page)


def quoted(column: str) -> str:
    return '"' + column.replace('"', '""') + '"'
