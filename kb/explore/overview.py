"""The first page: totals, what each stage left, what is out of date, and the newest crawls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kb.core.sources import PUBLISHED, SOURCES
from kb.core.summary import remaining
from kb.explore.tables import CurrentTables
from kb.store.layout import VERDICTS

_HOURS_OF_A_YEAR = 8766
_TOTALS = {  # tables → what is counted in them: SQL, noun
    "youtube_videos": (
        ("count(*)", "videos"),
        ("sum(duration_s) / 3600", "hours of video"),
        ("sum(word_count)", "words spoken"),
    ),
    "wiki_pages": (("count(*)", "wiki pages"),),
    "wiki_elements": (("count(x)", "boxes on pages"),),
    "reddit_posts": (("count(*)", "posts"),),
    "reddit_comments": (("count(*)", "comments"),),
    "pairs": (("count(*)", "video-text pairs"), ("count(DISTINCT keyword)", "keywords in them")),
    "tasks": (("count(*)", "task candidates"),),
    "entities": (("count(*)", "entities"),),
}


def read(tables: CurrentTables, about: Mapping[str, Any]) -> dict[str, Any]:
    """The page as the tables are now; `about` is what `kb status` knows. Raises DamagedData."""
    funnels = [made for name in SOURCES if (made := _funnel(tables, name)) is not None]
    return {"totals": _totals(tables), "funnels": funnels, "about": about}


def _totals(tables: CurrentTables) -> list[tuple[str, str]]:
    """(number, noun) of what the tables hold."""
    counted = {name: of for name, of in _TOTALS.items() if name in tables}
    counts: list[tuple[float | None, str]] = []
    with tables.asked(*counted) as con:
        for name, of in counted.items():
            sums = ", ".join(f"({sql})::DOUBLE" for sql, _ in of)
            (row,) = con.execute(f"SELECT {sums} FROM {tables.view(name).full}").fetchall()
            counts += zip(row, (noun for _, noun in of), strict=True)
    totals = []
    for total, noun in counts:
        if total and noun == "hours of video" and total >= _HOURS_OF_A_YEAR:
            totals.append((f"{total / _HOURS_OF_A_YEAR:,.1f}", "years of video"))
        elif total:
            totals.append((f"{total:,.0f}", noun))
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
    stages = [*(one for one in order if one in rejected), *sorted(set(rejected) - set(order))]
    dropped = {stage: rejected[stage] for stage in stages}
    dropped |= {one: verdicts[one] for one in ("failed", "pending") if verdicts[one]}
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
