"""The rows of a source by verdict, as a table whose rows lead to their own pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from math import isfinite
from typing import Any, NamedTuple
from urllib.parse import urlencode

from kb.core.errors import UsageError
from kb.core.sources import SOURCES
from kb.explore.conditions import MOST, TESTS, Condition, conditions, fields, sql_of
from kb.explore.tables import CurrentTables, page_number, quoted
from kb.look.headings import heading, plain, reading
from kb.schema.tables import table
from kb.store.layout import VERDICTS

PAGE = 50  # rows
_LAST = 1_000_000_000  # the number of a page
_KEPT = "kept"
_LONGEST = 300  # characters of a cell
_SORTED = 5_000  # rows that sorted pages reach: DuckDB keeps so few in a heap, and sorts no table

_WORDS = ("title", "text", "body")  # columns of which the first says what a row is
# Of rejected rows what says most comes first, and ids last.
_OF_VERDICT = (
    *("title", "text", "stage", "reason", "value", "threshold", "channel_title", "type"),
    *("matched", "unmatched", "key"),
)


class Cell(NamedTuple):
    """A value as the page shows it: its text, "" for none, and whether it is a number."""

    text: str
    is_number: bool = False


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
    conditions: tuple[Condition, ...] = ()

    @property
    def name(self) -> str:
        """The bare name of the table that holds the rows."""
        last = self.table if self.verdict == _KEPT else self.verdict
        return f"{self.source}_{last}"

    @property
    def declared(self) -> str:
        """The declared table of the rows."""
        is_kept = self.verdict == _KEPT
        return f"{self.source}/{self.table}" if is_kept else f"shared/{self.verdict}"

    def address_of(self, row: Mapping[str, Any]) -> str:
        """The address of a row's own page."""
        of = SOURCES[self.source]
        key = row.get("key") or f"{of.tables[self.table]}{row[table(self.declared).key[0]]}"
        return f"/document?{urlencode({'ref': f'{self.source}:{key}'})}"

    def address(self, **changes: Any) -> str:
        """The page's address with other values. The first page, unless `page` is given."""
        values = {**vars(self), "page": 1, **changes}
        filters = fields([*values.pop("conditions")])
        given = {name: int(v) if isinstance(v, bool) else v for name, v in values.items() if v}
        return f"/rows?{urlencode(given | filters)}"


@dataclass(frozen=True)
class RowsPage:
    """Rows as the page shows them: cells in the order of `columns`, which are (name, heading, is of
    numbers); the column `linked` leads to a row's own page. `total` are all that match.
    """

    asked: RowsQuery
    columns: list[tuple[str, str, bool]]
    linked: str
    rows: list[tuple[list[Cell], str]]
    total: int
    tables: list[str]
    verdicts: list[str]
    reasons: list[tuple[str, str, int]]
    filtered: list[str] = field(default_factory=list)
    tests: tuple[str, ...] = TESTS
    most_conditions: int = MOST
    sources: tuple[str, ...] = tuple(SOURCES)

    def words(self, stage: str, reason: str) -> str:
        """What people read for a stage and a reason: "number of views: below the limit"."""
        given = {"stage": stage, "reason": reason}
        named = {name: value for name, value in given.items() if value}
        return ": ".join(reading(self.asked.declared, name, value) for name, value in named.items())

    @property
    def conditions(self) -> list[Condition]:
        """What the columns of a row must be."""
        return [*self.asked.conditions]

    @property
    def sort(self) -> str:
        """The column that orders the rows, "" for none."""
        return self.asked.sort

    @property
    def descending(self) -> bool:
        """Whether the largest comes first."""
        return self.asked.descending

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
    sort = query.get("sort", "")
    return RowsQuery(
        source,
        verdict,
        table,
        query.get("stage", ""),
        query.get("reason", ""),
        query.get("text", ""),
        sort,
        query.get("descending", "") not in ("", "0"),
        page_number(query, _SORTED // PAGE if sort else _LAST),
        tuple(conditions(query)),
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
    shown = [name for name in SOURCES[asked.source].tables if f"{asked.source}_{name}" in tables]
    if asked.name not in tables:
        return RowsPage(asked, [], "", [], 0, shown, verdicts, [])
    with tables.asked(asked.name) as con:
        full = tables.view(asked.name).full
        kinds = {name: kind for name, kind, *_ in con.sql(f"DESCRIBE {full}").fetchall()}
        named = [asked.sort, *(condition.column for condition in asked.conditions)]
        columns = _columns(asked, kinds)
        columns += [name for name in dict.fromkeys(named) if name in kinds and name not in columns]
        where, values = _where(asked, kinds)
        if asked.sort and asked.sort not in kinds:
            raise UsageError(f"unknown column {asked.sort!r}")
        order = f"ORDER BY {quoted(asked.sort)}{' DESC' if asked.descending else ''} NULLS LAST"
        cut = "{0}[:{1}] AS {0}"
        listed = ", ".join(
            cut.format(quoted(name), _LONGEST) if kinds[name] == "VARCHAR" else quoted(name)
            for name in columns
        )
        total = con.execute(f"SELECT count(*) FROM {full} WHERE {where}", values).fetchall()[0][0]
        rows = con.sql(
            f"SELECT {listed} FROM {full} WHERE {where} {order if asked.sort else ''}"
            f" LIMIT {PAGE} OFFSET {(asked.page - 1) * PAGE}",
            params=values,
        ).to_arrow_table()
        reasons = []
        if asked.verdict != _KEPT:
            stage = "stage" if "stage" in kinds else "''"
            reasons = con.execute(
                f"SELECT {stage}, coalesce(reason, ''), count(*) AS n FROM {full} GROUP BY ALL"
                " ORDER BY ALL"
            ).fetchall()
    return _shown(asked, rows.to_pylist(), total, shown, verdicts, reasons, [*kinds])


def _shown(asked: RowsQuery, rows: list[dict[str, Any]], total: int, *others: Any) -> RowsPage:
    """The page of some rows, without columns that none of them has a value in."""
    names = [
        name for name in (rows[0] if rows else ()) if any(row[name] is not None for row in rows)
    ]
    cells = {name: [cell(asked.declared, name, row[name]) for row in rows] for name in names}
    columns = [
        (
            name,
            heading(asked.declared, name),
            all(cell.is_number or not cell.text for cell in cells[name]),
        )
        for name in names
    ]
    linked = next((name for name in (*_WORDS, *names) if name in names), "")
    shown = [
        ([cells[name][place] for name in names], asked.address_of(row))
        for place, row in enumerate(rows)
    ]
    return RowsPage(asked, columns, linked, shown, total, *others)


def cell(declared: str, name: str, value: Any) -> Cell:
    """A value for people; what the filters keep as text may be a number."""
    if value is None:
        return Cell("")
    if isinstance(value, datetime):
        return Cell(f"{value:%Y-%m-%d}", is_number=True)
    if name.endswith("_id"):
        return Cell(str(value))
    if (text := plain(value)) is not None:
        return Cell(text, is_number=not isinstance(value, bool))
    if name in ("value", "threshold") and (number := _number(str(value))) is not None:
        return Cell(f"{number:,.10g}", is_number=True)
    if name == "value" or table(declared).column(name).dictionary:
        return Cell(reading(declared, name, str(value)))
    if isinstance(value, list):
        return Cell(", ".join(map(str, value))[:_LONGEST])
    return Cell(str(value))


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if isfinite(number) else None


def _columns(asked: RowsQuery, kinds: Mapping[str, str]) -> list[str]:
    """Those that say most: of kept rows the report's samples, of others what was decided on."""
    if asked.verdict != _KEPT:
        return [name for name in _OF_VERDICT if name in kinds]
    samples = SOURCES[asked.source].sampled.get(f"{asked.source}/{asked.table}", ())
    key = next(iter(kinds))
    chosen = [*(name for name in samples if name in kinds and name != key), key]
    if len(chosen) > 1:
        return chosen
    others = [name for name in kinds if name not in _WORDS and not name.startswith("toxicity_")]
    return [*(name for name in _WORDS if name in kinds), *others[:12]]


def _where(asked: RowsQuery, kinds: Mapping[str, str]) -> tuple[str, list[str]]:
    parts, values = ["true", *sql_of([*asked.conditions], kinds)], []
    for name in ("stage", "reason"):
        if (wanted := getattr(asked, name)) and name in kinds:
            parts.append(f"{name} = ?")
            values.append(wanted)
    if asked.text:
        texts = [name for name, kind in kinds.items() if kind == "VARCHAR"]
        contained = " OR ".join(f"contains(lower({quoted(name)}), lower(?))" for name in texts)
        parts.append(f"({contained or 'false'})")
        values += [asked.text] * len(texts)
    return " AND ".join(parts), values
