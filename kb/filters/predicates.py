"""Declarative, vectorised predicates: the conditions a row must meet to be kept.

A row that does not pass gets a short reason, the value that decided and the threshold, as text. A
value that is needed and not there gives `absent`, one that could not be read `malformed` with what
was found (from the rows' `problems`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.types as kinds

from kb.schema.video_facts import NOT_PUBLIC
from kb.store.tables.columns import column

SCORED = "toxicity"  # the stage that looks at scores


class Judgement(NamedTuple):
    """One answer a row. `reason` is null where the row passes.

    `value` is text or null, `threshold` the same for every row. `verdict` is what becomes of rows
    with a reason: "rejected", "pending" or "failed", one for all or one each.
    """

    reason: pa.Array[Any]
    value: pa.Array[Any]
    threshold: str | None = None
    verdict: str | pa.Array[Any] = "rejected"

    def filter(self, mask: pa.Array[Any]) -> Judgement:
        """The answers of some rows."""
        parts: list[Any] = [
            part.filter(mask) if isinstance(part, pa.Array) else part for part in self
        ]
        return Judgement(*parts)


@dataclass(frozen=True)
class Threshold:
    """A number of each row, and the limit that it must reach or must not exceed.

    `setting` is the key of the limit in the profile ("youtube.min_views"), "" where it has none.
    With `at_least` a row passes with the limit or more, else with the limit or less. `numbers`
    returns the number of each row as float64, null where it is absent or malformed.
    """

    setting: str
    limit: float
    at_least: bool
    numbers: Callable[[pa.Table], pa.Array[Any]]


class Predicate(ABC):
    """A condition, and the stage of a chain that it belongs to.

    Most predicates only judge. `gate` are predicates whose outcome this one asks for.
    """

    stage: str
    gate: tuple[Predicate, ...] = ()

    @property
    @abstractmethod
    def reads(self) -> frozenset[str]:
        """The columns that the rows must have."""

    def fill(self, rows: pa.Table) -> pa.Table:
        """The rows with the columns that this predicate adds to the table."""
        return rows

    @abstractmethod
    def judge(self, rows: pa.Table) -> Judgement:
        """Which rows don't pass, and why. The rows went through `fill`."""

    def conditions(self, rows: pa.Table) -> tuple[pa.Array[Any], pa.Array[Any]]:
        """Of rows that don't pass: which of several conditions hold, and which don't, as text."""
        return nothing(rows), nothing(rows)

    def threshold(self) -> Threshold | None:
        """What it compares with what, for a page that tries other limits; None without a limit."""
        return None


def compared(
    rows: pa.Table,
    values: pa.Array[Any],
    outside: pa.Array[Any],
    reason: str,
    threshold: float | str | None,
    needed: Sequence[str],
) -> Judgement:
    """`reason` where `outside`; where a `needed` value is null,
    `malformed` or `absent` by the rows' problems.
    """
    out = pc.fill_null(outside, False)
    reasons = pc.if_else(out, reason, None).cast(pa.string())
    value = text(pc.if_else(out, values, pa.scalar(None, values.type)))
    is_missing = pc.is_null(values)
    if needed and pc.any(is_missing).as_py():
        bad = nothing(rows)
        for name in needed:
            bad = pc.coalesce(bad, malformed(rows, name))
        reasons = pc.if_else(
            is_missing, pc.if_else(pc.is_valid(bad), "malformed", "absent"), reasons
        )
        value = pc.if_else(is_missing, bad, value)
    return Judgement(reasons, value, None if threshold is None else number(threshold))


def malformed(rows: pa.Table, name: str) -> pa.Array[Any]:
    """The text of what could not be read as the column, null where all is well."""
    if "problems" not in rows.column_names or not rows.num_rows:
        return nothing(rows)
    problems = column(rows, "problems")
    entries = pc.list_flatten(problems)
    if not len(entries):
        return nothing(rows)
    hit = pc.and_(
        pc.equal(entries.field("column"), name), pc.equal(entries.field("reason"), "malformed")
    )
    parents = pc.list_parent_indices(problems).filter(hit)
    at = pc.index_in(pa.array(range(rows.num_rows), parents.type), value_set=parents)
    return entries.field("value").filter(hit).take(at)


def text(values: pa.Array[Any]) -> pa.Array[Any]:
    """Values as `rejected.value` shows them."""
    if kinds.is_floating(values.type):
        return pa.array(
            [None if value is None else number(value) for value in values.to_pylist()], pa.string()
        )
    return values.cast(pa.string())


def number(value: float | str) -> str:
    """A threshold or value as text: 1 rather than 1.0, six digits at most."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.6g}" if abs(value) < 1e6 else f"{value:.0f}"


def nothing(rows: pa.Table) -> pa.Array[Any]:
    """A text column of nulls."""
    return pa.nulls(rows.num_rows, pa.string())


def _as_double(values: pa.Array[Any]) -> pa.Array[Any]:
    return values.cast(pa.float64())


@dataclass(frozen=True)
class _OfOne(Predicate):
    """A predicate of one column."""

    column: str

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.column})

    def _numbers(self, rows: pa.Table) -> pa.Array[Any]:
        # A float32 is rounded to six decimals, so that 0.3 does not exceed 0.3.
        values = column(rows, self.column)
        numbers = _as_double(values)
        return pc.round(numbers, 6) if kinds.is_float32(values.type) else numbers


@dataclass(frozen=True)
class AtLeast(_OfOne):
    """The column is `least` or more."""

    least: float
    stage: str
    setting: str = ""

    def threshold(self) -> Threshold:
        return Threshold(self.setting, self.least, at_least=True, numbers=self._numbers)

    def judge(self, rows: pa.Table) -> Judgement:
        """`below`, `absent` or `malformed`."""
        values = column(rows, self.column)
        return compared(
            rows, values, pc.less(values, self.least), "below", self.least, (self.column,)
        )


@dataclass(frozen=True)
class RatioAtLeast(Predicate):
    """`top` / `bottom` is `least` or more; a bottom of 0 can't be read as a ratio."""

    top: str
    bottom: str
    least: float
    stage: str
    setting: str = ""

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.top, self.bottom})

    def threshold(self) -> Threshold:
        return Threshold(self.setting, self.least, at_least=True, numbers=self.ratio)

    def ratio(self, rows: pa.Table) -> pa.Array[Any]:
        """The ratio; null unless both are positive."""
        top, bottom = (_as_double(column(rows, name)) for name in (self.top, self.bottom))
        usable = pc.fill_null(pc.and_(pc.greater(top, 0), pc.greater(bottom, 0)), False)
        return pc.if_else(usable, pc.divide(top, pc.if_else(usable, bottom, 1.0)), None)

    def judge(self, rows: pa.Table) -> Judgement:
        """`below`, `absent` or `malformed`; the value is the ratio,
        or "top x bottom" of what is malformed.
        """
        ratio = self.ratio(rows)
        below = pc.less(ratio, self.least)
        judged = compared(
            rows, pc.round(ratio, 4), below, "below", self.least, (self.top, self.bottom)
        )
        both = pc.and_(*(pc.is_valid(column(rows, name)) for name in (self.top, self.bottom)))
        empty = pc.and_(both, pc.is_null(ratio))
        shape = pc.binary_join_element_wise(
            text(column(rows, self.top)), text(column(rows, self.bottom)), " x "
        )
        reason = pc.if_else(empty, "malformed", judged.reason)
        return Judgement(reason, pc.if_else(empty, shape, judged.value), judged.threshold)


@dataclass(frozen=True)
class AtMost(_OfOne):
    """The column is `most` or less. With `null_passes` a row without a value is kept."""

    most: float
    stage: str
    null_passes: bool = False
    reason: str = "above"
    setting: str = ""

    def threshold(self) -> Threshold:
        return Threshold(self.setting, self.most, at_least=False, numbers=self._numbers)

    def judge(self, rows: pa.Table) -> Judgement:
        """`reason`, and without `null_passes` also `absent` or `malformed`."""
        values = column(rows, self.column)
        limit = pa.scalar(self.most, values.type)  # a float32 score of 0.5 is no more than 0.5
        needed = () if self.null_passes else (self.column,)
        return compared(rows, values, pc.greater(values, limit), self.reason, self.most, needed)


def none_above(
    limit: float | None, scores: Mapping[str, str], setting: str = ""
) -> tuple[Predicate, ...]:
    """The scores (text → its column) at most `limit`; a text without a score passes, and without
    a limit every text.
    """
    if limit is None:
        return ()
    return tuple(
        AtMost(column, limit, SCORED, null_passes=True, reason=of, setting=setting)
        for of, column in scores.items()
    )


@dataclass(frozen=True)
class NotTrue(_OfOne):
    """The column is not true; null passes."""

    stage: str
    reason: str

    def judge(self, rows: pa.Table) -> Judgement:
        """`reason` where the column is true."""
        hit = pc.fill_null(column(rows, self.column), False)
        return Judgement(pc.if_else(hit, self.reason, None).cast(pa.string()), nothing(rows))


@dataclass(frozen=True)
class Present(_OfOne):
    """The column is not null."""

    stage: str

    def judge(self, rows: pa.Table) -> Judgement:
        """`absent` or `malformed`."""
        never = pa.array([False] * rows.num_rows, pa.bool_())
        return compared(rows, column(rows, self.column), never, "", None, (self.column,))


@dataclass(frozen=True)
class NotIn(_OfOne):
    """The column is none of `values`; null passes. The reason is the value's own."""

    values: tuple[Any, ...]
    stage: str

    def judge(self, rows: pa.Table) -> Judgement:
        """The value itself as the reason."""
        values = column(rows, self.column)
        hit = pc.is_in(values, pa.array(self.values, values.type))
        shown = pc.if_else(hit, text(values), None).cast(pa.string())
        return Judgement(shown, shown)


@dataclass(frozen=True)
class RecordedReason(Predicate):
    """The column is null; what it holds is the reason that was recorded,
    `value` the column of what goes with it. `verdict`: of the rows that have one.
    """

    column: str
    stage: str
    value: str = ""
    verdict: str = "rejected"

    @property
    def reads(self) -> frozenset[str]:
        return frozenset({self.column, self.value} - {""})

    def judge(self, rows: pa.Table) -> Judgement:
        """The column's own text."""
        reason = text(column(rows, self.column))
        value = text(column(rows, self.value)) if self.value else nothing(rows)
        return Judgement(
            reason,
            pc.if_else(pc.is_valid(reason), value, pa.scalar(None, pa.string())),
            verdict=self.verdict,
        )


@dataclass(frozen=True)
class In(_OfOne):
    """The column is one of `values`."""

    values: tuple[Any, ...]
    stage: str

    def judge(self, rows: pa.Table) -> Judgement:
        """`other`, `absent` or `malformed`."""
        values = column(rows, self.column)
        other = pc.invert(pc.is_in(values, pa.array(self.values, values.type)))
        allowed = ", ".join(str(value) for value in self.values)
        return compared(rows, values, other, "other", allowed, (self.column,))


@dataclass(frozen=True)
class Waits(_OfOne):
    """Rows whose column is one of `values` are not rejected: they are pending, or failed,
    with `reason`.
    """

    values: tuple[Any, ...]
    stage: str
    reason: str
    verdict: str = "pending"

    def judge(self, rows: pa.Table) -> Judgement:
        """`reason`."""
        hit = pc.is_in(
            column(rows, self.column), pa.array(self.values, rows.schema.field(self.column).type)
        )
        return Judgement(
            pc.if_else(hit, self.reason, None).cast(pa.string()),
            nothing(rows),
            verdict=self.verdict,
        )


def rows_passing(predicates: Sequence[Predicate], rows: pa.Table) -> pa.Array[Any]:
    """Which rows pass all of them: the crawl asks this before it spends requests on a row."""
    good = pa.array([True] * rows.num_rows, pa.bool_())
    for predicate in predicates:
        good = pc.and_(good, pc.is_null(predicate.judge(rows).reason))
    return good


PUBLIC = NotIn("availability", NOT_PUBLIC, stage="not_public")

NO_TRANSCRIPT = ("none", "disabled", "unavailable", "age_restricted")


def transcript_required() -> tuple[Predicate, ...]:
    """Stage `transcript`: a video without one is rejected.

    It is pending while the transcript was not fetched yet or needs a PO token, and failed when all
    tries failed.
    """
    return (
        Waits(
            "transcript_outcome",
            ("failed",),
            stage="transcript",
            reason="transcript",
            verdict="failed",
        ),
        Waits("transcript_outcome", ("po_token",), stage="transcript", reason="po_token"),
        Waits("transcript_kind", ("unknown",), stage="transcript", reason="transcript"),
        NotIn("transcript_outcome", NO_TRANSCRIPT, stage="transcript"),
    )
