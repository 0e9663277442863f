"""Deduplication: keeps the newest of several rows with one key."""

from collections.abc import Sequence

import pyarrow as pa
import pyarrow.compute as pc


def newest(rows: pa.Table, key: Sequence[str], by: Sequence[str]) -> pa.Table:
    """The greatest row of each key in the order of the columns `by`, sorted by key.

    Of rows that are equal in these the one that comes last stays. A null is the least value: an
    answer that doesn't say when it was read is older than any that does. A null in a key is equal
    to no other. Without key columns one row stays of all.
    """
    if rows.num_rows < 2:
        return rows
    names = [*key, *by]
    # A stable sort, so what is equal keeps its order.
    order = pc.sort_indices(
        rows.select(names), sort_keys=[(name, "ascending", "at_start") for name in names]
    )
    same = pa.array([True] * (rows.num_rows - 1), pa.bool_())
    for name in key:
        column = rows.column(name).take(order).combine_chunks()
        equal = pc.equal(column.slice(0, len(column) - 1), column.slice(1))
        same = pc.and_(same, pc.fill_null(equal, False))
    last = pa.concat_arrays([pc.invert(same), pa.array([True], pa.bool_())])
    return rows.take(order.filter(last))


def duplicates(rows: pa.Table, kept: pa.Table, echo: str = "") -> int:
    """How many rows `newest` left out; those that are true in the column `echo` repeat nothing."""
    left_out = rows.num_rows - kept.num_rows
    if echo:
        left_out -= (pc.sum(rows[echo]).as_py() or 0) - (pc.sum(kept[echo]).as_py() or 0)
    return left_out
