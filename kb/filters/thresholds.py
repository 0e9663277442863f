"""Stages with a threshold: the number they compare, and what the other stages make of a row.

The filter keeps both for each row that such a stage rejects (`rejected.number` and
`rejected.other_stages`), so that `kb explore` can tell what another threshold would keep without
filtering again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.filters.predicates import SCORED, Predicate, Threshold
from kb.store.tables.columns import column

UNSCORED = "unscored"  # kept, if the toxicity stage passes texts that have no score yet


@dataclass(frozen=True)
class StageThreshold:
    """A stage that compares numbers with one threshold: a single one, or several, such as the
    scores of a title and of a description. `reads` are the columns that it needs.
    """

    stage: str
    reads: frozenset[str]
    setting: str
    limit: float
    at_least: bool
    parts: tuple[Threshold, ...]

    def numbers(self, rows: pa.Table) -> pa.Array[Any]:
        """The number that decides for each row, float64: of several the one nearest to failing.

        Null where none is there.
        """
        nearest = pc.min_element_wise if self.at_least else pc.max_element_wise
        return nearest(*(part.numbers(rows) for part in self.parts))


def thresholds(stages: Iterable[Predicate]) -> list[StageThreshold]:
    """The stages that have a threshold, in order."""
    by_stage: dict[str, StageThreshold] = {}
    for predicate in stages:
        stage, part = predicate.stage, predicate.threshold()
        if part is None:
            continue
        before = by_stage.get(stage)
        by_stage[stage] = StageThreshold(
            stage,
            predicate.reads | (before.reads if before else frozenset()),
            part.setting,
            part.limit,
            part.at_least,
            (*(before.parts if before else ()), part),
        )
    return list(by_stage.values())


def outcome_of_other_stages(
    rows: pa.Table, stages: Sequence[Predicate], position: int, texts: Sequence[str]
) -> pa.Array[Any]:
    """What becomes of rows that the stage at `position` drops, if it let them pass.

    "kept", "rejected", "failed", "pending", or UNSCORED where only the score of one of the `texts`
    is missing. The rows passed the earlier stages; of these one with a gate is asked again, because
    a topic waits for its label only while the row passes the stages of its gate.
    """
    dropped = stages[position].stage
    outcome = pa.nulls(rows.num_rows, pa.string())
    passing: Any = "kept"
    for place, predicate in enumerate(stages):
        if predicate.stage == dropped or (place < position and not predicate.gate):
            continue
        if predicate.stage == SCORED and not predicate.reads <= set(rows.column_names):
            filled = (pc.greater(pc.binary_length(column(rows, name)), 0) for name in texts)
            any_text = reduce(pc.or_kleene, filled, pa.array([False] * rows.num_rows))
            passing = pc.if_else(pc.fill_null(any_text, False), UNSCORED, "kept")
            continue
        if place > position:
            rows = predicate.fill(rows)
        judged = _without(predicate, dropped).judge(rows)
        out = pc.and_(pc.is_null(outcome), pc.is_valid(judged.reason))
        outcome = pc.if_else(out, judged.verdict, outcome)
    return pc.if_else(pc.is_null(outcome), passing, outcome)


def _without(predicate: Predicate, stage: str) -> Predicate:
    """The predicate, its gate without a stage."""
    if not predicate.gate:
        return predicate
    gate = tuple(other for other in predicate.gate if other.stage != stage)
    return replace(predicate, gate=gate)  # type: ignore[type-var]
