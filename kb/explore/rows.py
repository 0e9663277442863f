"""The pages of rows: how many each stage left, those of a source by verdict, pairs of a keyword.

The folder is listed anew for each page, so that a filter, export or purge that ran meanwhile shows
at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlencode

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from kb.artifacts.table_catalog import Catalog, View, bare
from kb.core.errors import UsageError
from kb.core.sources import PUBLISHED, SOURCES
from kb.query.views import connect
from kb.store.tables.reading import reading
from kb.store.tables.row_counts import VERDICTS

PAGE = 50  # rows
_LAST = 1_000_000_000  # the number of a page
_KEPT = "kept"
_LONGEST = 300  # characters of a cell
_SORTED = 5_000  # rows that sorted pages reach: DuckDB keeps so few in a heap, and sorts no table

Parameters = Sequence[Any]


PAIRS_ON_A_PAGE = 20  # pairs
_LAST_OF_PAIRS = 5_000  # pages


@dataclass(frozen=True)
class RowsQuery:
    """What the page's address asks for. `table` is for kept rows, `stage` and `reason` for others;
    `text` is looked for in every text column.
    """

    source: str
    verdict: str = _KEPT
    table: str = ""
    stage: str = ""
    reason: str = ""
    text: str = ""
    sort: str = ""
    descending: bool = False
    page: int = 1

    @property
    def name(self) -> str:
        """The bare name of the table that holds the rows."""
        last = self.table if self.verdict == _KEPT else self.verdict
        return f"{self.source}_{last}"

    def address(self, **changes: Any) -> str:
        """The page's address with other values. The first page, unless `page` is given."""
        values = {**vars(self), "page": 1, **changes}
        given = {name: int(v) if isinstance(v, bool) else v for name, v in values.items() if v}
        return f"/rows?{urlencode(given)}"


@dataclass(frozen=True)
class RowsPage:
    """Rows as the page shows them: texts in the order of `columns`. `total` are all that match."""

    asked: RowsQuery
    columns: list[str]
    rows: list[list[str]]
    total: int
    tables: list[str]
    verdicts: list[str]
    reasons: list[tuple[str, str, int]]
    sources: tuple[str, ...] = tuple(SOURCES)

    @property
    def reached(self) -> int:
        """How many of the rows pages show: sorted ones end early."""
        return min(self.total, _SORTED) if self.asked.sort else self.total

    @property
    def pages(self) -> int:
        """How many pages can be turned."""
        return max(1, -(-self.reached // PAGE))


def parse(query: Mapping[str, str]) -> RowsQuery:
    """The question in an address. Raises UsageError for a value that no page has."""
    source = query.get("source", next(iter(SOURCES)))
    verdict = query.get("verdict", _KEPT)
    if source not in SOURCES:
        raise UsageError(f"unknown source {source!r}", hint=f"use one of {', '.join(SOURCES)}")
    if verdict not in (_KEPT, *VERDICTS):
        raise UsageError(f"unknown verdict {verdict!r}")
    tables = [*SOURCES[source].tables]
    table = query.get("table") or tables[0]
    if table not in tables:
        raise UsageError(f"unknown table {table!r}", hint=f"use one of {', '.join(tables)}")
    page = query.get("page", "1")
    sort = query.get("sort", "")
    last = _SORTED // PAGE if sort else _LAST
    if not page.isascii() or not page.isdigit() or not 1 <= int(page) <= last:
        raise UsageError(f"there is no page {page!r}")
    return RowsQuery(
        source,
        verdict,
        table,
        query.get("stage", ""),
        query.get("reason", ""),
        query.get("text", ""),
        sort,
        query.get("descending", "") not in ("", "0"),
        int(page),
    )


def read(tables: CurrentTables, asked: RowsQuery) -> RowsPage:
    """The rows of a page. Raises UsageError for a column that the table lacks, DamagedData."""
    verdicts = [
        verdict
        for verdict in (_KEPT, *VERDICTS)
        if any(
            f"{asked.source}_{table if verdict == _KEPT else verdict}" in tables
            for table in SOURCES[asked.source].tables
        )
    ]
    shown = [one for one in SOURCES[asked.source].tables if f"{asked.source}_{one}" in tables]
    if asked.name not in tables:
        return RowsPage(asked, [], [], 0, shown, verdicts, [])
    with tables.asked(asked.name) as con:
        full = tables.view(asked.name).full
        kinds = {name: kind for name, kind, *_ in con.sql(f"DESCRIBE {full}").fetchall()}
        columns = _columns(asked, kinds)
        where, values = _where(asked, kinds)
        if asked.sort and asked.sort not in kinds:
            raise UsageError(f"unknown column {asked.sort!r}")
        order = f"ORDER BY {quoted(asked.sort)}{' DESC' if asked.descending else ''} NULLS LAST"
        listed = ", ".join(f"({quoted(name)}::VARCHAR)[:{_LONGEST}]" for name in columns)
        total = con.execute(f"SELECT count(*) FROM {full} WHERE {where}", values).fetchall()[0][0]
        rows = con.execute(
            f"SELECT {listed} FROM {full} WHERE {where} {order if asked.sort else ''}"
            f" LIMIT {PAGE} OFFSET {(asked.page - 1) * PAGE}",
            values,
        ).fetchall()
        reasons = []
        if asked.verdict != _KEPT:
            stage = "stage" if "stage" in kinds else "''"
            reasons = con.execute(
                f"SELECT {stage}, coalesce(reason, ''), count(*) AS n FROM {full} GROUP BY ALL"
                " ORDER BY ALL"
            ).fetchall()
    return RowsPage(
        asked,
        columns,
        [["" if value is None else value for value in row] for row in rows],
        total,
        shown,
        verdicts,
        reasons,
    )


def _columns(asked: RowsQuery, kinds: Mapping[str, str]) -> list[str]:
    """Those that say most: of kept rows the report's samples, of others all but `number`, which
    repeats the value.
    """
    if asked.verdict != _KEPT:
        return [name for name in kinds if name != "number"]
    samples = SOURCES[asked.source].sampled.get(f"{asked.source}/{asked.table}", ())
    key = next(iter(kinds))
    chosen = [key, *(name for name in samples if name in kinds and name != key)]
    return chosen if len(chosen) > 1 else [*kinds][:12]


def _where(asked: RowsQuery, kinds: Mapping[str, str]) -> tuple[str, list[str]]:
    conditions, values = ["true"], []
    for name in ("stage", "reason"):
        if (wanted := getattr(asked, name)) and name in kinds:
            conditions.append(f"{name} = ?")
            values.append(wanted)
    if asked.text:
        texts = [name for name, kind in kinds.items() if kind == "VARCHAR"]
        found = " OR ".join(f"contains(lower({quoted(name)}), lower(?))" for name in texts)
        conditions.append(f"({found or 'false'})")
        values += [asked.text] * len(texts)
    return " AND ".join(conditions), values


class CurrentTables:
    """The tables of a data root or release, by full and by bare name."""

    def __init__(self, root: Path) -> None:
        self.catalog = Catalog(root)
        views = self.catalog.views
        self._named = {view.full: view for view in views} | bare(views)

    def __contains__(self, name: str) -> bool:
        return name in self._named

    def view(self, name: str) -> View:
        """A table by its name. Raises KeyError."""
        return self._named[name]

    def columns(self, name: str) -> frozenset[str]:
        """The columns of a table. Raises KeyError, DamagedData."""
        first = self.view(name).files[0]
        with reading([first]):
            return frozenset(pq.read_schema(first).names)

    def count(self, name: str) -> int:
        """The rows of a table, 0 of one that is not there. Raises DamagedData."""
        files = self.view(name).files if name in self else []
        with reading(files):
            return sum(pq.read_metadata(path).num_rows for path in files)

    @contextmanager
    def asked(self, *names: str) -> Iterator[duckdb.DuckDBPyConnection]:
        """A connection that reads these tables and nothing else. Raises DamagedData."""
        views = [self.view(name) for name in names]
        files = [path for view in views for path in view.files]
        with reading(files), connect(None, views) as con:
            yield con

    def rows(self, name: str, sql: str, parameters: Parameters = ()) -> pa.Table:
        """The result of a query over one table, which it calls {table}. Raises DamagedData."""
        with self.asked(name) as con:
            query = sql.format(table=self.view(name).full)
            return con.sql(query, params=list(parameters)).to_arrow_table()


def quoted(column: str) -> str:
    return '"' + column.replace('"', '""') + '"'


class FunnelStep(NamedTuple):
    """Rows that are left after a stage, and their share of all that were crawled."""

    name: str
    left: int
    rejected: int
    share: float


class SourceFunnel(NamedTuple):
    """A source's steps in order, and its rows by verdict."""

    source: str
    title: str
    steps: list[FunnelStep]
    verdicts: dict[str, int]


def read_funnel(tables: CurrentTables) -> list[SourceFunnel]:
    """The funnel of each source that has rows. Raises DamagedData."""
    return [made for name in SOURCES if (made := _funnel(tables, name)) is not None]


def _funnel(tables: CurrentTables, source: str) -> SourceFunnel | None:
    of = SOURCES[source]
    kept = sum(tables.count(f"{source}_{table}") for table in of.tables)
    verdicts = {verdict: tables.count(f"{source}_{verdict}") for verdict in VERDICTS}
    crawled = kept + sum(verdicts.values())
    if not crawled:
        return None
    rejected: dict[str, int] = {}
    if f"{source}_rejected" in tables:
        by_stage = "SELECT stage::VARCHAR AS stage, count(*) AS n FROM {table} GROUP BY 1"
        counted = tables.rows(f"{source}_rejected", by_stage)
        rejected = dict(zip(*(column.to_pylist() for column in counted.columns), strict=True))
    order = [*PUBLISHED[source].stages]
    stages = [*(one for one in order if one in rejected), *sorted(set(rejected) - set(order))]
    dropped = {stage: rejected[stage] for stage in stages}
    dropped |= {one: verdicts[one] for one in ("failed", "pending") if verdicts[one]}
    left, steps = crawled, [FunnelStep("crawled", crawled, 0, 1.0)]
    for stage, n in dropped.items():
        left -= n
        steps.append(FunnelStep(stage, left, n, left / crawled))
    return SourceFunnel(source, of.title, steps, {"kept": kept, **verdicts})


@dataclass(frozen=True)
class PairsPage:
    """Pairs in the order of video and time, each a row of the tables with `url` and `quality`."""

    keyword: str
    kind: str
    page: int
    total: int
    pairs: list[dict[str, Any]]
    keywords: list[tuple[str, int]]
    kinds: list[str]

    @property
    def pages(self) -> int:
        """How many there are."""
        return max(1, min(_LAST_OF_PAIRS, -(-self.total // PAIRS_ON_A_PAGE)))

    def address(self, page: int) -> str:
        """The address of another page of the same pairs."""
        given = {"keyword": self.keyword, "kind": self.kind, "page": page}
        return f"/pairs?{urlencode({name: value for name, value in given.items() if value})}"


def read_pairs(tables: CurrentTables, query: Mapping[str, str]) -> PairsPage:
    """The pairs that an address asks for. Raises UsageError, DamagedData."""
    keyword, kind, page = query.get("keyword", ""), query.get("kind", ""), query.get("page", "1")
    if not page.isascii() or not page.isdigit() or not 1 <= int(page) <= _LAST_OF_PAIRS:
        raise UsageError(f"there is no page {page!r}")
    if "pairs" not in tables:
        return PairsPage(keyword, kind, 1, 0, [], [], [])
    names = ["pairs", *(name for name in ("pairs_quality", "youtube_videos") if name in tables)]
    with tables.asked(*names) as con:
        full = tables.view("pairs").full
        keywords = con.execute(
            f"SELECT keyword, count(*) AS n FROM {full} GROUP BY 1 ORDER BY n DESC, 1"
        ).fetchall()
        kinds = con.execute(f"SELECT DISTINCT keyword_kind::VARCHAR FROM {full} ORDER BY 1")
        given = [one for (one,) in kinds.fetchall()]
        where = "(? = '' OR lower(keyword) = lower(?)) AND (? = '' OR keyword_kind = ?)"
        values = [keyword, keyword, kind, kind]
        total = con.execute(f"SELECT count(*) FROM {full} WHERE {where}", values).fetchall()[0][0]
        found = con.sql(
            f"FROM {full} WHERE {where} ORDER BY video_id, clip_start_s, pair_id"
            f" LIMIT {PAIRS_ON_A_PAGE} OFFSET {(int(page) - 1) * PAIRS_ON_A_PAGE}",
            params=values,
        )
        pairs = found.to_arrow_table().to_pylist()
        about = {
            name: _by_key(con, tables.view(name).full, key, pairs)
            for name, key in (("pairs_quality", "pair_id"), ("youtube_videos", "video_id"))
            if name in names
        }
    for pair in pairs:
        start = int(pair["clip_start_s"])
        pair["url"] = f"https://www.youtube.com/watch?v={pair['video_id']}&t={start}s"
        pair["title"] = about.get("youtube_videos", {}).get(pair["video_id"], {}).get("title")
        quality = about.get("pairs_quality", {}).get(pair["pair_id"], {})
        pair["quality"] = {
            name: value
            for name, value in quality.items()
            if name not in ("pair_id", "video_id") and value is not None
        }
    return PairsPage(keyword, kind, int(page), total, pairs, keywords, given)


def _by_key(
    con: duckdb.DuckDBPyConnection, full: str, key: str, pairs: list[dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """The rows of another table that belong to the pairs of this page."""
    wanted = sorted({pair[key] for pair in pairs})
    query = f"FROM {full} WHERE {key} IN (SELECT unnest(?::VARCHAR[]))"
    found = con.sql(query, params=[wanted])
    return {row[key]: row for row in found.to_arrow_table().to_pylist()}
