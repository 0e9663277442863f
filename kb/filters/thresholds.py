"""Stages with a threshold: the number they compare, and what the other stages make of a row.

The filter keeps both for each row that such a stage rejects (`rejected.number` and
`rejected.other_stages`), so that `kb explore` can tell what another threshold would keep without
filtering again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.compute as pc

from kb.filters.predicates import SCORED, Predicate, one

UNSCORED = "unscored"  # kept, if the toxicity stage passes texts that have no score yet


class ThresholdPredicate(Predicate, Protocol):
    """A predicate that compares a number of each row with a threshold.

    `setting` is the threshold's key in the profile ("youtube.min_views"), "" where it has none.
    """

    @property
    def setting(self) -> str: ...

    @property
    def limit(self) -> float: ...

    @property
    def at_least(self) -> bool:
        """Whether numbers from the limit upwards pass; else those up to it do."""
        ...

    def measured(self, rows: pa.Table) -> pa.Array[Any]:
        """The number of each row, float64; null where it is absent or malformed."""
        ...


@dataclass(frozen=True)
class StageThreshold:
    """The predicates of a stage that compare numbers with the same threshold, such as the scores
    of a title and of a description.
    """

    stage: str
    predicates: tuple[ThresholdPredicate, ...]

    @property
    def limit(self) -> float:
        """The threshold."""
        return self.predicates[0].limit

    @property
    def setting(self) -> str:
        """The threshold's key in the profile, "" where it has none."""
        return self.predicates[0].setting

    @property
    def at_least(self) -> bool:
        """Whether a row passes with the limit or more; else with the limit or less."""
        return self.predicates[0].at_least

    @property
    def reads(self) -> frozenset[str]:
        """The columns that it needs."""
        return frozenset[str]().union(*(predicate.reads for predicate in self.predicates))

    def numbers(self, rows: pa.Table) -> pa.Array[Any]:
        """The number that decides for each row, float64: of several the one nearest to failing.

        Null where none is there.
        """
        nearest = pc.min_element_wise if self.at_least else pc.max_element_wise
        numbers: pa.Array[Any] = nearest(*(each.measured(rows) for each in self.predicates))
        return numbers


def thresholds(stages: Iterable[Predicate]) -> list[StageThreshold]:
    """The stages that have a threshold, in order."""
    by_stage: dict[str, list[Any]] = {}
    for predicate in stages:
        if hasattr(predicate, "measured"):
            by_stage.setdefault(predicate.stage, []).append(predicate)
    return [StageThreshold(stage, tuple(predicates)) for stage, predicates in by_stage.items()]


def outcome_of_other_stages(
    rows: pa.Table, stages: Sequence[Predicate], position: int, texts: Sequence[str]
) -> pa.Array[Any]:
    """What becomes of rows that the stage at `position` drops, if it let them pass.

    "kept", "rejected", "failed", "pending", or UNSCORED where only the score of one of the `texts`
    is missing. Earlier stages are asked again, because a topic waits for its label only while the
    row passes the stages of its gate.
    """
    dropped = stages[position].stage
    outcome = pa.nulls(rows.num_rows, pa.string())
    passing: Any = "kept"
    for place, predicate in enumerate(stages):
        if predicate.stage == dropped:
            continue
        if predicate.stage == SCORED and not predicate.reads <= set(rows.column_names):
            passing = pc.if_else(pc.fill_null(_any_text(rows, texts), False), UNSCORED, "kept")
            continue
        if place > position and hasattr(predicate, "fill"):
            rows = predicate.fill(rows)
        judged = _without(predicate, dropped).judge(rows)
        out = pc.and_(pc.is_null(outcome), pc.is_valid(judged.reason))
        outcome = pc.if_else(out, judged.verdict, outcome)
    decided: pa.Array[Any] = pc.if_else(pc.is_null(outcome), passing, outcome)
    return decided


def _without(predicate: Any, stage: str) -> Predicate:
    """The predicate, its gate without a stage."""
    if not hasattr(predicate, "gate"):
        return predicate  # type: ignore[no-any-return]
    gate = tuple(one for one in predicate.gate if one.stage != stage)
    changed: Predicate = replace(predicate, gate=gate)
    return changed


def _any_text(rows: pa.Table, names: Sequence[str]) -> Any:
    """Which rows have a text to score."""
    filled = (pc.greater(pc.binary_length(one(rows, name)), 0) for name in names)
    return reduce(pc.or_kleene, filled, pa.array([False] * rows.num_rows))
