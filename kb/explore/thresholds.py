"""What another threshold would keep: figures, a histogram, and rows on both sides of the line.

The figures are those of a filter run with the other threshold. Nothing is written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from kb.core.config.profile import Profile
from kb.core.errors import UsageError
from kb.explore.histogram import Histogram, draw, edges_of
from kb.explore.tables import CurrentTables
from kb.explore.threshold_rows import NearRow, rows_of
from kb.explore.threshold_stages import StageOfTable, stages_of
from kb.filters.thresholds import UNSCORED
from kb.store.tables import database

GROUPS = 20
_WAITING = {
    "pending": "wait for the next crawl",
    UNSCORED: "wait for a toxicity score, which the next filter computes",
    "failed": "count as failed",
}


@dataclass(frozen=True)
class ThresholdFigures:
    """What a `value` keeps, instead of the `current` threshold of the stage: rows `kept` now, and
    of these and the rejected ones how many are `lost` and `won`.

    `waiting` are numbers of rejected rows that would then wait, with what for. `groups` are (name,
    rows lost, rows won). `outside` and `inside` are the rows next to the line.
    """

    stage: StageOfTable
    histogram: Histogram
    current: float
    value: float
    kept: int
    lost: int
    won: int
    waiting: list[tuple[int, str]]
    groups: list[tuple[str, int, int]]
    outside: list[NearRow]
    inside: list[NearRow]
    has_rejected: bool
    is_outdated: bool

    @property
    def plain_value(self) -> str:
        """The value as TOML and HTML write it."""
        value = self.value
        return str(int(value) if value == int(value) else value)

    @property
    def profile_line(self) -> tuple[str, str]:
        """The section and the line of the profile that set the value; "" without a setting."""
        section, _, key = self.stage.threshold.setting.rpartition(".")
        return (f"[{section}]", f"{key} = {self.plain_value}") if key else ("", "")


@dataclass(frozen=True)
class ThresholdPage:
    """The stages that have a threshold, and the figures of one; None where no stage has."""

    stages: list[StageOfTable]
    figures: ThresholdFigures | None = None

    @property
    def same_setting(self) -> list[str]:
        """The other stages that the same key of the profile decides."""
        if self.figures is None or not self.figures.stage.threshold.setting:
            return []
        stage = self.figures.stage
        return [
            one.name
            for one in self.stages
            if one.threshold.setting == stage.threshold.setting and one.name != stage.name
        ]


def read(tables: CurrentTables, profile: Profile, query: Mapping[str, str]) -> ThresholdPage:
    """The page of an address: the first stage without one, its current threshold without a value.

    `step` is a position of the slider; `value` any number. Raises UsageError, DamagedData.
    """
    stages = list(stages_of(tables, profile))
    return ThresholdPage(
        stages, _figures(tables, _chosen(stages, query), query) if stages else None
    )


def _chosen(stages: list[StageOfTable], query: Mapping[str, str]) -> StageOfTable:
    asked = [(name, query[name]) for name in ("source", "table", "stage") if query.get(name)]
    for one in stages:
        known = {"source": one.source, "table": one.table, "stage": one.threshold.stage}
        if all(known[name] == value for name, value in asked):
            return one
    given = " ".join(value for _, value in asked)
    raise UsageError(f"there is no threshold of {given!r}")


def _figures(
    tables: CurrentTables, stage: StageOfTable, query: Mapping[str, str]
) -> ThresholdFigures:
    rows = rows_of(tables, stage)
    at_least = stage.threshold.at_least
    with database.asking() as con:
        con.register("numbers", rows.numbers)
        edges = edges_of(con, rows.limit, at_least)
        value = _value(query, edges, rows.limit)
        con.register("judged", rows.numbers.append_column("passes", rows.passes(value)))
        lost, won = "kept AND NOT passes", "NOT kept AND outcome = 'kept' AND passes"
        kept, n_lost, n_won = con.execute(
            f"SELECT count(*) FILTER (kept), count(*) FILTER ({lost}), count(*) FILTER ({won})"
            " FROM judged"
        ).fetchall()[0]
        waiting = con.execute(
            "SELECT count(*), outcome FROM judged WHERE NOT kept AND passes GROUP BY 2 ORDER BY 2"
        ).fetchall()
        groups = con.execute(
            f"""SELECT "group", count(*) FILTER ({lost}) AS lost, count(*) FILTER ({won}) AS won
            FROM judged WHERE "group" IS NOT NULL GROUP BY 1 HAVING lost + won > 0
            ORDER BY lost + won DESC, 1 LIMIT {GROUPS}"""
        ).fetchall()
        histogram = draw(con, edges, rows.limit, value, at_least)
    return ThresholdFigures(
        stage,
        histogram,
        rows.limit,
        value,
        kept,
        n_lost,
        n_won,
        [(n, _WAITING[outcome]) for n, outcome in waiting if outcome in _WAITING],
        groups,
        list(rows.nearest(value, inside=False)),
        list(rows.nearest(value, inside=True)),
        stage.rejected in tables,
        rows.is_outdated,
    )


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
