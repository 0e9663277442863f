"""The first page: totals, what each stage left, what is out of date, and the newest crawls."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from kb.artifacts.table_catalog import view_name
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import remaining
from kb.explore.tables import CurrentTables
from kb.schema import table
from kb.store.layout import VERDICTS


def read(tables: CurrentTables, about: Mapping[str, Any]) -> dict[str, Any]:
    """The page as the tables are now; `about` is what `kb status` knows. Raises DamagedData."""
    funnels = [made for name in SOURCES if (made := _funnel(tables, name)) is not None]
    return {"totals": _totals(tables), "funnels": funnels, "about": about}


def _totals(tables: CurrentTables) -> list[tuple[str, str]]:
    """(number, noun) of what the tables hold: the totals that the report shows."""
    totals = []
    for noun, name, sql in itertools.chain(*(source.totals for source in PUBLISHED.values())):
        if (view := view_name(table(name))) in tables:
            row = tables.rows(view, f"SELECT ({sql})::DOUBLE FROM {{table}}")
            if total := row.column(0)[0].as_py():
                text = f"{total:.2g}" if total % 1 and total < 10 else f"{total:,.0f}"
                totals.append((text, noun))
    return totals


def _funnel(tables: CurrentTables, source: str) -> dict[str, Any] | None:
    """A source's rows by verdict, and what was left after each stage, in order."""
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
    stages = [*(stage for stage in order if stage in rejected), *sorted(set(rejected) - set(order))]
    dropped = {stage: rejected[stage] for stage in stages}
    dropped |= {
        verdict: verdicts[verdict] for verdict in ("failed", "pending") if verdicts[verdict]
    }
    steps = [
        {"name": name, "left": left, "rejected": n, "share": left / crawled}
        for name, left, n in remaining(crawled, dropped.items())
    ]
    return {
        "source": source,
        "title": of.title,
        "steps": steps,
        "verdicts": {"kept": kept, **verdicts},
    }
