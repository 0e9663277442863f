"""What Arrow's tables lack: columns replaced by name, rows aligned with keys, lists by length."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc


def column(rows: pa.Table, name: str) -> Any:
    """A column as one array."""
    chunks = rows.column(name)
    combined = chunks.combine_chunks() if chunks.num_chunks != 1 else chunks.chunk(0)
    return pa.concat_arrays(combined.chunks) if isinstance(combined, pa.ChunkedArray) else combined


def put(rows: pa.Table, name: str, values: Any) -> pa.Table:
    """The rows with these values as the column `name`, in its place where there is one."""
    if name in rows.column_names:
        return rows.set_column(rows.column_names.index(name), name, values)
    return rows.append_column(name, values)


def with_nulls(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    """The rows with the nullable columns of the schema that they lack, as nulls: those of a table
    that an older version wrote, or that nobody filled.
    """
    for field in schema:
        if field.nullable and field.name not in rows.column_names:
            rows = rows.append_column(field, pa.nulls(rows.num_rows, field.type))
    return rows


def aligned(rows: pa.Table, key: str, keys: Any) -> pa.Table:
    """The row of each of `keys` in the column `key`; nulls for a key without one."""
    if not rows.num_rows:
        return pa.table({field.name: pa.nulls(len(keys), field.type) for field in rows.schema})
    return rows.take(pc.index_in(keys, value_set=column(rows, key))).combine_chunks()


def lists(lengths: pa.Array[Any], values: pa.Array[Any]) -> pa.Array[Any]:
    """The values in lists of these lengths; a null length is an empty list."""
    ends = pc.cumulative_sum(pc.fill_null(lengths, 0).cast(pa.int32()))
    return pa.ListArray.from_arrays(pa.concat_arrays([pa.array([0], pa.int32()), ends]), values)


def sums(of: pa.Array[Any]) -> pa.Array[Any]:
    """The sum of each list of numbers (int64); 0 for an empty one."""
    flat = pc.list_flatten(of).cast(pa.int64())
    totals = pa.concat_arrays([pa.array([0], pa.int64()), pc.cumulative_sum(flat)])
    lengths = pc.list_value_length(of).cast(pa.int64())
    ends = pc.cumulative_sum(lengths)
    return pc.subtract(totals.take(ends), totals.take(pc.subtract(ends, lengths)))
