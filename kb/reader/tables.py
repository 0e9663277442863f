"""Tables and query results, with conversions (Arrow, pandas, polars, and HTML in notebooks), and
the tables of several folders with one connection over them.
"""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, overload

import duckdb
import pyarrow as pa

from kb import query
from kb.artifacts.release_folder import read_tombstones
from kb.artifacts.table_catalog import SCHEMAS, Catalog, View, bare, check_once
from kb.core.cached_property import cached_property
from kb.core.errors import FatalError, MissingExtra, UsageError
from kb.core.installation import ds
from kb.core.suggestions import did_you_mean, similar
from kb.query.formats import as_box
from kb.query.remote_reading import reading_views
from kb.reader import html
from kb.reader.hints import with_hints
from kb.store.tables import parquet
from kb.store.tables.checksums import library_path
from kb.store.tables.reading import reading
from kb.store.tables.remote_files import first_rows, parquet_dataset, reading_at

if TYPE_CHECKING:
    import datasets
    import pandas
    import polars

_SHOWN = 5  # rows of `head`


class RowSet:
    """What tables and query results have in common: everything but the origin of the rows."""

    _shown = _SHOWN  # rows that are printed, or shown in a notebook

    @property
    def schema(self) -> pa.Schema:
        """Names and types of the columns; for a declared table also their meaning."""
        raise NotImplementedError

    @property
    def columns(self) -> list[str]:
        """The names of the columns."""
        return self.schema.names

    def to_table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """All rows as a pyarrow.Table, of all or some columns. Raises DamagedData."""
        raise NotImplementedError

    def to_arrow(self, columns: Sequence[str] | None = None) -> pa.Table:
        """All rows as a pyarrow.Table, of all or some columns. Raises DamagedData."""
        return self.to_table(columns)

    def head(self, rows: int = _SHOWN) -> pa.Table:
        """The first rows as a pyarrow.Table."""
        raise NotImplementedError

    def count_rows(self) -> int:
        """The number of rows, as of `len()`."""
        raise NotImplementedError

    @with_hints
    def to_pandas(self, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """All rows as a DataFrame; integers with nulls stay integers (Int64). Raises MissingExtra
        without pandas, DamagedData.

        data["youtube_videos"].to_pandas(["title", "view_count"]).describe()
        """
        needs("pandas")
        rows = self.to_table(columns)
        frame = rows.to_pandas()
        for name, column in zip(rows.column_names, rows.columns, strict=True):
            if column.null_count and pa.types.is_integer(column.type):
                frame[name] = column.to_pandas(types_mapper=_nullable)
        return frame

    @with_hints
    def to_polars(self, columns: Sequence[str] | None = None) -> polars.DataFrame:
        """All rows as a polars.DataFrame. Raises MissingExtra without polars, DamagedData.

        data.sql("FROM pairs").to_polars().group_by("keyword").len()
        """
        needs("polars")
        import polars

        return cast("polars.DataFrame", polars.from_arrow(self.to_table(columns)))

    @with_hints
    def to_pylist(self, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """All rows as dictionaries. Raises DamagedData, FatalError for a time that Python lacks."""
        return _as_dictionaries(self.to_table(columns))

    @with_hints
    def to_hf(self, columns: Sequence[str] | None = None) -> datasets.Dataset:
        """All rows as a Dataset of Hugging Face. Raises MissingExtra without `datasets`,
        DamagedData.

        data.sql("SELECT keyword, video_id FROM pairs").to_hf().train_test_split(0.1)
        """
        needs("datasets")
        import datasets

        return datasets.Dataset(datasets.table.InMemoryTable(self.to_table(columns)))

    def batches(self) -> Iterable[pa.RecordBatch]:
        """All rows, a batch at a time."""
        raise NotImplementedError

    @with_hints
    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Each row as a dictionary."""
        for batch in self.batches():
            yield from _as_dictionaries(batch)

    @overload
    def __getitem__(self, place: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, place: slice) -> QueryResult: ...
    @overload
    def __getitem__(self, place: str) -> pa.ChunkedArray[Any]: ...
    @with_hints
    def __getitem__(self, place: int | slice | str) -> Any:
        """A row by its number, rows by a slice, or a column by its name.

        data["pairs"][0]; data["pairs"][10:20].to_pandas(); data["pairs"]["keyword"]
        """
        if isinstance(place, str):
            return self.to_table([place])[place]
        numbers = range(len(self))
        if isinstance(place, slice):
            return QueryResult(self._rows_at(numbers[place]))
        return _as_dictionaries(self._rows_at(range(numbers[place], numbers[place] + 1)))[0]

    def _rows_at(self, numbers: range) -> pa.Table:
        """The rows with these numbers."""
        last = max(numbers, default=-1)
        return self.head(last + 1).take(pa.array(numbers, pa.int64()))

    def __len__(self) -> int:
        return self.count_rows()

    def __bool__(self) -> bool:
        return True  # even without rows

    def _caption(self) -> str:
        columns = html.count(len(self.schema), "column")
        return f"{html.count(self.count_rows(), 'row')}, {columns}"

    def __repr__(self) -> str:
        width = shutil.get_terminal_size().columns
        return f"{self._caption()}\n{''.join(as_box(self.head(self._shown).to_reader(), width))}"

    def _repr_html_(self) -> str:
        first = self.head(self._shown)
        values = zip(*(column.to_pylist() for column in first.columns), strict=True)
        return html.rows(first.column_names, values, self._caption())


class TableView(RowSet):
    """One table: all its shards as one, read when needed.

    videos = data["youtube_videos"]
    videos.schema; len(videos); videos.to_pandas()
    videos.dataset                      # the pyarrow.dataset.Dataset, for filters and batches

    All other methods of a pyarrow Dataset (`scanner`, `to_batches`, `filter` …) work as well.
    """

    def __init__(self, view: View) -> None:
        self.view = view

    @property
    def name(self) -> str:
        """The full name: "release.youtube_videos"."""
        return self.view.full

    @property
    def doc(self) -> str:
        """What a row stands for."""
        return self.view.doc

    @property
    def files(self) -> list[Path]:
        """The shards, in order; none of a table that is read at an address."""
        return list(self.view.files)

    @property
    def _is_list(self) -> bool:
        """Whether this is a list of tombstones, which is read as a whole."""
        return self.view.lists_tombstones

    def _reading(self) -> AbstractContextManager[None]:
        """What turns a failed read into an error that names the file or address."""
        home = self.view.home
        return reading(self.view.files) if isinstance(home, Path) else reading_at(home.address)

    @cached_property
    def dataset(self) -> ds.Dataset:
        """The shards as a pyarrow Dataset, with checksums verified. Raises DamagedData."""
        with self._reading():
            if self.view.remote is not None:
                return self.view.remote.dataset
            if self._is_list:
                return ds.dataset(read_tombstones(self.view.files[0]))
            parquet.verify_files(*self.view.files)
            return parquet_dataset(list(map(library_path, self.view.files)))

    @property
    def schema(self) -> pa.Schema:
        """Columns with their types; `schema.field("fps").metadata` explains one."""
        if self._is_list or self.view.remote is not None:
            return self.dataset.schema
        with reading(self.view.files):
            return parquet.footer(self.view.files[0]).schema.to_arrow_schema()

    @with_hints
    def to_table(
        self, columns: Sequence[str] | None = None, filter: ds.Expression | None = None
    ) -> pa.Table:
        """All rows as a pyarrow.Table, of some columns or rows only. Raises DamagedData.

        import pyarrow.compute as pc
        data["pairs"].to_table(["video_id"], filter=pc.field("keyword") == "Creeper")
        """
        chosen = None if columns is None else list(columns)
        for name in chosen or ():
            if name not in self.schema.names:
                near = similar(name, self.schema.names)
                raise UsageError(
                    f"{self.name} has no column {name!r}",
                    hint=f"did you mean {' or '.join(near)}?" if near else ".schema lists them",
                )
        with self._reading():
            return self.dataset.to_table(columns=chosen, filter=filter)

    def head(self, rows: int = _SHOWN) -> pa.Table:
        """The first rows, without reading the others."""
        with self._reading():
            return first_rows(self.dataset, rows)

    def batches(self) -> Iterable[pa.RecordBatch]:
        """All rows, a batch at a time. Raises DamagedData."""
        with self._reading():
            yield from self.dataset.to_batches()

    @with_hints
    def count_rows(self) -> int:
        """The number of rows, from the files' footers. Raises DamagedData."""
        with self._reading():
            if self._is_list or self.view.remote is not None:
                return int(self.dataset.count_rows())
            return sum(parquet.footer(path).num_rows for path in self.view.files)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def _caption(self) -> str:
        return f"{self.name}: {self.doc} {super()._caption()}"


class QueryResult(RowSet):
    """The rows of a query, in memory."""

    _shown = 20

    def __init__(self, rows: pa.Table) -> None:
        self._rows = rows

    @property
    def schema(self) -> pa.Schema:
        """Names and types of the columns."""
        return self._rows.schema

    def to_table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """The rows as a pyarrow.Table."""
        return self._rows if columns is None else self._rows.select(list(columns))

    def head(self, rows: int = _SHOWN) -> pa.Table:
        """The first rows."""
        return self._rows.slice(0, rows)

    def count_rows(self) -> int:
        """The number of rows."""
        return int(self._rows.num_rows)

    def batches(self) -> Iterable[pa.RecordBatch]:
        """The rows, a batch at a time."""
        return self._rows.to_batches()


class Tables(Mapping[str, TableView]):
    """Every table by its bare name; `release.youtube_videos` names one of several.

    list(data.tables); data.tables["youtube_videos"]; "clean.reddit_posts" in data.tables

    A bare name means the clean table if there is one, else the released, else the restored one.
    """

    def __init__(self, views: list[View]) -> None:
        self._short = {name: view.full for name, view in sorted(bare(views).items())}
        self._full = {view.full: TableView(view) for view in sorted(views)}

    @with_hints
    def __getitem__(self, name: str) -> TableView:
        full = self._short.get(name, name)
        if full in self._full:
            return self._full[full]
        near = similar(name, [*self._short, *self._full])
        raise UnknownTable(
            f"unknown table {name!r}.{did_you_mean(near)}",
            hint="data.tables lists them",
        )

    def __contains__(self, name: object) -> bool:
        return name in self._short or name in self._full

    def __iter__(self) -> Iterator[str]:
        return iter(self._short)

    def __len__(self) -> int:
        return len(self._short)

    def all(self) -> list[TableView]:
        """Every table, including those that need a schema in their name."""
        return list(self._full.values())

    def _repr_html_(self) -> str:
        reached = set(self._short.values())
        lines = [
            (
                table.name.partition(".")[2] if table.name in reached else table.name,
                table.name.partition(".")[0],
                table.count_rows(),
                len(table.schema),
                table.doc,
            )
            for table in self._full.values()
        ]
        return html.rows(["table", "schema", "rows", "columns", "a row is"], lines)

    def __repr__(self) -> str:
        return f"<kb tables: {', '.join(self._short)}>"


class UnknownTable(UsageError, KeyError):
    """An unknown table name; also a KeyError, as from any mapping."""

    def __str__(self) -> str:
        return str(self.args[0])


def needs(package: str, *, install: str = "") -> None:
    """Raise MissingExtra, with a hint, if an optional package is not installed."""
    if find_spec(package) is None:
        install = install or package
        raise MissingExtra(f"{install} is not installed", hint=f"install the package {install}")


def _nullable(kind: pa.DataType) -> Any:
    """pandas' type of integers that may be null."""
    import pandas

    return pandas.api.types.pandas_dtype(str(kind).replace("i", "I").replace("u", "U"))


def _as_dictionaries(rows: pa.Table | pa.RecordBatch) -> list[dict[str, Any]]:
    try:
        return rows.to_pylist()
    except OverflowError:
        raise FatalError(
            "a time in these rows is of no year from 1 to 9999",
            hint="take to_arrow(), or cast the column to text in SQL",
        ) from None


class OpenTables:
    """Tables by their full names; DuckDB is opened for the first query. `remote`: tables that are
    read at an address.

    Raises UsageError if two of the folders contain the same table.
    """

    def __init__(self, catalogs: Sequence[Catalog], remote: Iterable[View] = ()) -> None:
        self.catalogs = catalogs
        self.named: dict[str, View] = {}
        for view in [*(view for catalog in catalogs for view in catalog.views), *remote]:
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
            for view in used:
                view.verify_files()
            return self.con.sql(sql, params=list(parameters)).to_arrow_table()

    def folders(self) -> list[str]:
        return sorted({str(view.home) for view in self.views})
