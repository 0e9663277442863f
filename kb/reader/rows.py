"""Tables and answers, with the ways out of them: Arrow, pandas, polars, and HTML in a notebook."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from kb.artifacts.catalog import View
from kb.artifacts.release_folder import read_tombstones
from kb.core.errors import MissingExtra, UsageError
from kb.reader import html
from kb.reader.hints import hinted
from kb.store import parquet
from kb.store.reading import reading

if TYPE_CHECKING:
    import pandas
    import polars

_PARQUET = ds.ParquetFileFormat(
    default_fragment_scan_options=ds.ParquetFragmentScanOptions(page_checksum_verification=True)
)
_SHOWN = 5  # rows in a notebook


class RowSet:
    """What a table and an answer have in common: everything but where the rows come from."""

    @property
    def schema(self) -> pa.Schema:
        """Names and types of the columns; of a declared table also what each means."""
        raise NotImplementedError

    def to_table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """All rows as a pyarrow.Table, of all or some columns. Raises DamagedData."""
        raise NotImplementedError

    def head(self, rows: int = _SHOWN) -> pa.Table:
        """The first rows as a pyarrow.Table."""
        raise NotImplementedError

    def count_rows(self) -> int:
        """How many rows there are; `len()` says the same."""
        raise NotImplementedError

    @hinted
    def to_pandas(self, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """All rows as a DataFrame. Raises MissingExtra without pandas, DamagedData.

        data["youtube_videos"].to_pandas(["title", "view_count"]).describe()
        """
        needs("pandas")
        return self.to_table(columns).to_pandas()

    @hinted
    def to_polars(self, columns: Sequence[str] | None = None) -> polars.DataFrame:
        """All rows as a polars.DataFrame. Raises MissingExtra without polars, DamagedData.

        data.sql("FROM pairs").to_polars().group_by("keyword").len()
        """
        needs("polars")
        import polars

        return cast("polars.DataFrame", polars.from_arrow(self.to_table(columns)))

    @hinted
    def to_pylist(self, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """All rows as dictionaries. Raises DamagedData."""
        return self.to_table(columns).to_pylist()

    def __len__(self) -> int:
        return self.count_rows()

    def __bool__(self) -> bool:
        return True  # a table without rows is one all the same

    def _caption(self) -> str:
        columns = html.count(len(self.schema), "column")
        return f"{html.count(self.count_rows(), 'row')}, {columns}"

    def _repr_html_(self) -> str:
        first = self.head()
        values = zip(*(column.to_pylist() for column in first.columns), strict=True)
        return html.rows(first.column_names, values, self._caption())


class TableView(RowSet):
    """One table: all its shards as one, read when they are asked for.

    videos = data["youtube_videos"]
    videos.schema; len(videos); videos.to_pandas()
    videos.dataset                      # the pyarrow.dataset.Dataset, for filters and batches

    What a pyarrow Dataset can do beside this (`scanner`, `to_batches`, `filter` …), this can too.
    """

    def __init__(self, view: View) -> None:
        self.view = view
        self._dataset: ds.Dataset | None = None

    @property
    def name(self) -> str:
        """The full name: "release.youtube_videos"."""
        return self.view.full

    @property
    def doc(self) -> str:
        """What a row is."""
        return self.view.doc

    @property
    def files(self) -> list[Path]:
        """The shards, in order."""
        return list(self.view.files)

    @property
    def _is_list(self) -> bool:
        """Whether this is a release's list of tombstones, which is no Parquet."""
        return self.view.files[0].suffix == ".ndjson"

    @property
    def dataset(self) -> ds.Dataset:
        """The shards as a pyarrow Dataset, every byte of them checked. Raises DamagedData."""
        if self._dataset is None and self._is_list:
            self._dataset = ds.dataset(read_tombstones(self.view.files[0]))
        if self._dataset is None:
            with reading(self.view.files):
                parquet.check(*self.view.files)
                self._dataset = ds.dataset(list(map(str, self.view.files)), format=_PARQUET)
        return self._dataset

    @property
    def schema(self) -> pa.Schema:
        """Columns with their types; `schema.field("fps").metadata` says what one means."""
        if self._dataset is not None or self._is_list:
            return self.dataset.schema
        with reading(self.view.files):
            pq.read_metadata(self.view.files[0])
            return pq.read_schema(self.view.files[0])

    @hinted
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
                near = difflib.get_close_matches(name, self.schema.names, 3)
                raise UsageError(
                    f"{self.name} has no column {name!r}",
                    hint=f"did you mean {' or '.join(near)}?" if near else ".schema lists them",
                )
        with reading(self.view.files):
            return self.dataset.to_table(columns=chosen, filter=filter)

    def head(self, rows: int = _SHOWN) -> pa.Table:
        """The first rows, without reading the others."""
        with reading(self.view.files):
            return self.dataset.head(rows)

    @hinted
    def count_rows(self) -> int:
        """How many rows there are, by the files' footers. Raises DamagedData."""
        if self._is_list:
            return int(self.dataset.count_rows())
        with reading(self.view.files):
            return sum(pq.read_metadata(path).num_rows for path in self.view.files)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def _caption(self) -> str:
        return f"{self.name}: {self.doc} {super()._caption()}"

    def __repr__(self) -> str:
        return f"<kb table {self.name}>"


class QueryResult(RowSet):
    """The rows of a query, in memory."""

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
        """How many rows there are."""
        return int(self._rows.num_rows)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Each row as a dictionary."""
        for batch in self._rows.to_batches():
            yield from batch.to_pylist()

    def _repr_html_(self) -> str:
        first = self.head(20)
        values = zip(*(column.to_pylist() for column in first.columns), strict=True)
        return html.rows(first.column_names, values, self._caption())

    def __repr__(self) -> str:
        return f"<kb answer: {self._caption()}>"


def needs(package: str, *, install: str = "") -> None:
    """Raises MissingExtra, which says what to type, where an optional package is not there."""
    if find_spec(package) is None:
        install = install or package
        raise MissingExtra(f"{install} is not installed", hint=f"install the package {install}")
