"""How many rows of each source were crawled, and how many are left after each stage."""

from __future__ import annotations

from typing import NamedTuple

from kb.core.sources import PUBLISHED, SOURCES
from kb.explore.tables import CurrentTables
from kb.store.tables.row_counts import VERDICTS


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


def read(tables: CurrentTables) -> list[SourceFunnel]:
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
    left = crawled - verdicts["failed"] - verdicts["pending"]
    steps = [FunnelStep("judged", left, 0, left / crawled)]
    for stage in stages:
        left -= rejected[stage]
        steps.append(FunnelStep(stage, left, rejected[stage], left / crawled))
    return SourceFunnel(source, of.title, steps, {"kept": kept, **verdicts})
