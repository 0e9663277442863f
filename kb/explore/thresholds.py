"""What another threshold would keep: figures, a histogram, and rows on both sides of the line.

Rows that are kept have their numbers in the clean tables. Rows that this stage alone rejects have
them in `rejected`, with what the other stages decide (kb.filters.thresholds), so that the figures
are those of a filter run with the other threshold. Nothing is written.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple
from urllib.parse import urlencode

import duckdb
import pyarrow as pa
import pyarrow.compute as pc

from kb.core.config import pipeline
from kb.core.config.profile import Profile
from kb.core.errors import UsageError
from kb.core.sources import RELEASES, SPECS
from kb.explore.histogram import Histogram, draw, edges_of
from kb.explore.tables import CurrentTables, quoted
from kb.filters.chain import Chain
from kb.filters.predicates import number as shown
from kb.filters.thresholds import UNSCORED, StageThreshold, thresholds
from kb.schema.tables import table as declared
from kb.store.tables import database

EXAMPLES = 20  # on each side of the line
GROUPS = 20
_LONGEST = 160  # characters of an example's text
_WAITING = {
    "pending": "wait for the next crawl",
    UNSCORED: "wait for a toxicity score, which the next filter computes",
    "failed": "count as failed",
}


class StageOfTable(NamedTuple):
    """A stage with a threshold, and the table whose rows it judges. Rows of the tables `followers`
    are kept only with their row of this one.
    """

    source: str
    table: str
    threshold: StageThreshold
    chain: Chain
    followers: tuple[str, ...]

    @property
    def name(self) -> str:
        """How pages call it: "youtube videos: views"."""
        return f"{self.source} {self.table}: {self.threshold.stage}"

    @property
    def address(self) -> str:
        """The address of its page."""
        named = {"source": self.source, "table": self.table, "stage": self.threshold.stage}
        return f"/thresholds?{urlencode(named)}"

    @property
    def sign(self) -> str:
        """How a number compares with the limit in a row that passes."""
        return "≥" if self.threshold.at_least else "≤"


@dataclass(frozen=True)
class Example:
    """A row near the line. `now` and `then` are its outcomes by the two thresholds."""

    key: str
    number: str
    text: str
    now: str
    then: str
    address: str = ""
    is_local: bool = False


@dataclass(frozen=True)
class ThresholdPage:
    """The figures for one value: rows kept now, and of these and the rejected ones how many are
    lost and won. `groups` are (name, lost, won). The rows of the tables `followers` depend on the
    rows of this one, and are not counted.
    """

    stages: list[StageOfTable]
    stage: StageOfTable | None = None
    histogram: Histogram | None = None
    current: float = 0
    value: float = 0
    kept: int = 0
    lost: int = 0
    won: int = 0
    waiting: tuple[tuple[int, str], ...] = ()
    group: str = ""
    groups: tuple[tuple[str, int, int], ...] = ()
    failing: tuple[Example, ...] = ()
    passing: tuple[Example, ...] = ()
    followers: tuple[str, ...] = ()
    has_rejected: bool = True
    outdated: bool = False

    @property
    def same_setting(self) -> list[str]:
        """The other stages that the same key of the profile decides."""
        if self.stage is None or not self.stage.threshold.setting:
            return []
        others = (one for one in self.stages if one.address != self.stage.address)
        setting = self.stage.threshold.setting
        return [one.name for one in others if one.threshold.setting == setting]

    @property
    def plain_value(self) -> str:
        """The value as TOML and HTML write it."""
        value = self.value
        return str(int(value)) if value == int(value) and abs(value) >= 1 else f"{value:g}"

    @property
    def profile_line(self) -> tuple[str, str]:
        """The section and the line of the profile that set the value; "" without a setting."""
        if self.stage is None or not self.stage.threshold.setting:
            return "", ""
        section, _, key = self.stage.threshold.setting.rpartition(".")
        return f"[{section}]", f"{key} = {self.plain_value}"


def read(tables: CurrentTables, profile: Profile, query: Mapping[str, str]) -> ThresholdPage:
    """The page of an address: the first stage without one, its current threshold without a value.

    `step` is a position of the slider; `value` any number. Raises UsageError, DamagedData.
    """
    stages = list(_stages(tables, profile))
    if not stages:
        return ThresholdPage([])
    stage = _chosen(stages, query)
    numbers, current, outdated = _numbers(tables, stage)
    with database.asking() as con:
        con.register("numbers", numbers)
        edges = edges_of(con, current, stage.threshold.at_least)
        value = _value(query, edges, current)
        passes = f"number {'>=' if stage.threshold.at_least else '<='} {value!r}"
        kept, lost, won = con.execute(
            f"""SELECT count(*) FILTER (kept), count(*) FILTER (kept AND NOT {passes}),
            count(*) FILTER (NOT kept AND outcome = 'kept' AND {passes}) FROM numbers"""
        ).fetchall()[0]
        waiting = con.execute(
            f"""SELECT count(*), outcome FROM numbers WHERE NOT kept AND {passes}
            GROUP BY outcome ORDER BY 2"""
        ).fetchall()
        groups = con.execute(
            f"""SELECT "group", count(*) FILTER (kept AND NOT {passes}) AS lost,
            count(*) FILTER (NOT kept AND outcome = 'kept' AND {passes}) AS won FROM numbers
            WHERE "group" IS NOT NULL GROUP BY 1 HAVING lost + won > 0
            ORDER BY lost + won DESC, 1 LIMIT {GROUPS}"""
        ).fetchall()
        outside, inside = (_nearest(con, stage, passes, is_passing=side) for side in (False, True))
        histogram = draw(con, edges, current, value, stage.threshold.at_least)
    failing = tuple(_examples(tables, stage, outside, is_passing=False))
    passing = tuple(_examples(tables, stage, inside, is_passing=True))
    return ThresholdPage(
        stages,
        stage,
        histogram,
        current,
        value,
        kept,
        lost,
        won,
        tuple((n, _WAITING[outcome]) for n, outcome in waiting if outcome in _WAITING),
        _group(stage.chain),
        tuple(groups),
        failing,
        passing,
        stage.followers,
        f"{stage.source}_rejected" in tables,
        outdated,
    )


def _stages(tables: CurrentTables, profile: Profile) -> Iterator[StageOfTable]:
    for source in SPECS:
        if getattr(profile, source, None) is None:
            continue
        clean = pipeline.load(str(pipeline.locate(source))).clean(profile)
        following = [one.table.partition("/")[2] for one in clean.chains if one.relate is not None]
        for chain in clean.chains:
            table = chain.table.partition("/")[2]
            if f"{source}_{table}" not in tables:
                continue
            for threshold in thresholds(chain.stages):
                if threshold.reads <= tables.columns(f"{source}_{table}"):
                    followers = tuple(following) if chain.relate is None else ()
                    yield StageOfTable(source, table, threshold, chain, followers)


def _chosen(stages: list[StageOfTable], query: Mapping[str, str]) -> StageOfTable:
    asked = [(name, query[name]) for name in ("source", "table", "stage") if query.get(name)]
    for one in stages:
        known = {"source": one.source, "table": one.table, "stage": one.threshold.stage}
        if all(known[name] == value for name, value in asked):
            return one
    given = " ".join(value for _, value in asked)
    raise UsageError(f"there is no threshold of {given!r}")


def _value(query: Mapping[str, str], edges: list[float], current: float) -> float:
    try:
        if step := query.get("step"):
            return edges[min(max(int(step), 0), len(edges) - 1)]
        value = float(query.get("value") or current)
        if math.isfinite(value):
            return value
    except ValueError:
        pass
    given = query.get("step") or query.get("value")
    raise UsageError(f"the threshold is {given!r}, not a number")


def _numbers(tables: CurrentTables, stage: StageOfTable) -> tuple[pa.Table, float, bool]:
    """Rows of (key, number, kept, outcome, group) that this stage alone decides or may decide,
    the threshold that the tables were filtered with, and whether they lack what this needs.
    """
    chain, threshold, group = stage.chain, stage.threshold, _group(stage.chain)
    key = declared(chain.table).key[0]
    view = f"{stage.source}_{stage.table}"
    shared = group if group in tables.columns(view) else "NULL::VARCHAR"
    columns = ", ".join(sorted(threshold.reads))
    rows = tables.rows(
        view, f'SELECT {key}::VARCHAR AS key, {shared} AS "group", {columns} FROM {{table}}'
    )
    kept = pa.table(
        {
            "key": pc.binary_join_element_wise(chain.prefix, rows["key"], ""),
            "number": threshold.numbers(rows),
            "kept": pa.repeat(True, rows.num_rows),
            "outcome": pa.repeat("kept", rows.num_rows),
            "group": rows["group"],
        }
    )
    name = f"{stage.source}_rejected"
    if name not in tables:
        return kept, threshold.limit, False
    if "number" not in tables.columns(name):
        return kept, threshold.limit, True
    rejected = tables.rows(
        name,
        f"""SELECT key, number, false AS kept, other_stages::VARCHAR AS outcome,
            {group or "NULL"}::VARCHAR AS "group", threshold::VARCHAR AS threshold FROM {{table}}
            WHERE stage = ? AND starts_with(key, ?) AND number IS NOT NULL""",
        [threshold.stage, chain.prefix],
    )
    limit = float(rejected["threshold"][0].as_py()) if rejected.num_rows else threshold.limit
    both = [kept, rejected.drop_columns(["threshold"])]
    return pa.concat_tables(both, promote_options="permissive"), limit, False


def _group(chain: Chain) -> str:
    """The column by which changes are counted: the channel of videos, the type of posts."""
    named = [name for name in ("channel_title", "type") if name in chain.described_by]
    return named[0] if named else ""


class _Near(NamedTuple):
    key: str
    number: float
    kept: bool
    outcome: str


def _nearest(
    con: duckdb.DuckDBPyConnection, stage: StageOfTable, passes: str, *, is_passing: bool
) -> list[_Near]:
    """The rows next to the line on one side of it, the nearest first."""
    upwards = stage.threshold.at_least == is_passing
    rows = con.execute(
        f"""SELECT key, number, kept, outcome FROM numbers
        WHERE number IS NOT NULL AND ({passes}) = {is_passing}
        ORDER BY number {"ASC" if upwards else "DESC"}, key LIMIT {EXAMPLES}"""
    ).fetchall()
    return [_Near(*row) for row in rows]


def _examples(
    tables: CurrentTables, stage: StageOfTable, rows: list[_Near], *, is_passing: bool
) -> Iterator[Example]:
    view, prefix = f"{stage.source}_{stage.table}", stage.chain.prefix
    key_column = declared(stage.chain.table).key[0]
    texts = _texts(tables, view, key_column, [row.key.removeprefix(prefix) for row in rows])
    rejected = f"{stage.source}_rejected"
    titles = _texts(tables, rejected, "key", [row.key for row in rows if not row.kept])
    agent = SPECS[stage.source].agent
    is_main = stage.table == RELEASES[stage.source].main
    for row in rows:
        key = row.key.removeprefix(prefix)
        address = ""
        if agent is not None and row.kept:
            address = f"/document?{urlencode({'ref': f'{stage.source}:{row.key}'})}"
        elif agent is not None and is_main:
            address = agent.item.format(key=key)
        yield Example(
            key,
            shown(row.number),
            (texts.get(key) or titles.get(row.key) or "")[:_LONGEST],
            "kept" if row.kept else "rejected",
            row.outcome if is_passing else "rejected",
            address,
            row.kept,
        )


def _texts(tables: CurrentTables, name: str, key: str, keys: list[str]) -> dict[str, str]:
    """The title, else the body, of rows by key."""
    columns = tables.columns(name) if name in tables else frozenset[str]()
    text = next((one for one in ("title", "body") if one in columns), "")
    if not keys or not text:
        return {}
    query = f"SELECT {quoted(key)}::VARCHAR, {quoted(text)} FROM {{table}} WHERE {quoted(key)}"
    found = tables.rows(name, f"{query}::VARCHAR IN (SELECT unnest(?::VARCHAR[]))", [keys])
    return dict(zip(*(column.to_pylist() for column in found.columns), strict=True))
