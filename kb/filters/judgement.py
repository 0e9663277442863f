"""What a stage answers for each row, and the columns of text that such answers are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.types as kinds

SCORED = "toxicity"  # the stage that looks at scores


class Judgement(NamedTuple):
    """One answer a row. `reason` is null where the row passes.

    `value` is text or null, `threshold` the same for every row. `verdict` is what becomes of rows
    with a reason: "rejected", "pending" or "failed", one for all or one each. `matched` and
    `unmatched` say of several conditions which held, as text.
    """

    reason: pa.Array[Any]
    value: pa.Array[Any]
    threshold: str | None = None
    verdict: str | pa.Array[Any] = "rejected"
    matched: pa.Array[Any] | None = None
    unmatched: pa.Array[Any] | None = None


class Predicate(Protocol):
    """One stage of a chain."""

    @property
    def stage(self) -> str: ...

    @property
    def reads(self) -> frozenset[str]: ...
    def judge(self, rows: pa.Table) -> Judgement: ...


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


def malformed(rows: pa.Table, column: str) -> pa.Array[Any]:
    """The text of what could not be read as `column`, null where all is well."""
    if "problems" not in rows.column_names or not rows.num_rows:
        return nothing(rows)
    problems = one(rows, "problems")
    entries = pc.list_flatten(problems)
    if not len(entries):
        return nothing(rows)
    hit = pc.and_(
        pc.equal(entries.field("column"), column), pc.equal(entries.field("reason"), "malformed")
    )
    parents = pc.list_parent_indices(problems).filter(hit)
    at = pc.index_in(pa.array(range(rows.num_rows), parents.type), value_set=parents)
    values: pa.Array[Any] = entries.field("value").filter(hit).take(at)
    return values


def one(rows: pa.Table, name: str) -> pa.Array[Any]:
    """A column as one array."""
    column = rows.column(name)
    combined = column.combine_chunks() if column.num_chunks != 1 else column.chunk(0)
    return pa.concat_arrays(combined.chunks) if isinstance(combined, pa.ChunkedArray) else combined


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
