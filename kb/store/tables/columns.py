"""What Arrow's tables lack: columns replaced by name, rows aligned with keys, the newest row of a
key, lists by length, words of texts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from kb.core.installation import np, pc


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


def where(rows: pa.Table, condition: Any) -> pa.Table:
    """The rows where the condition is true; not copied where it is for all."""
    return rows if pc.all(condition, skip_nulls=False).as_py() else rows.filter(condition)


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
        values = rows.column(name).take(order).combine_chunks()
        equal = pc.equal(values.slice(0, len(values) - 1), values.slice(1))
        same = pc.and_(same, pc.fill_null(equal, False))
    last = pa.concat_arrays([pc.invert(same), pa.array([True], pa.bool_())])
    return rows.take(order.filter(last))


def duplicates(rows: pa.Table, kept: pa.Table, echo: str = "") -> int:
    """How many rows `newest` left out; those that are true in the column `echo` repeat nothing."""
    left_out = rows.num_rows - kept.num_rows
    if echo:
        left_out -= (pc.sum(rows[echo]).as_py() or 0) - (pc.sum(kept[echo]).as_py() or 0)
    return left_out


# What `str.split` takes for white space beyond ASCII
_OTHER_SPACES = r"[\x{85}\x{a0}\x{1680}\x{2000}-\x{200a}\x{2028}\x{2029}\x{202f}\x{205f}\x{3000}]"


def word_count(texts: pa.Array[Any]) -> pa.Array[Any]:
    """Words of each text, as `str.split` separates them (int64); 0 for null."""
    texts = pc.fill_null(texts.cast(pa.string()), "")
    other = pc.invert(pc.string_is_ascii(texts))
    if pc.any(other).as_py():
        spaced = pc.replace_substring_regex(texts.filter(other), _OTHER_SPACES, " ")
        texts = pc.replace_with_mask(texts, other, spaced)
    offsets: Any
    content: Any
    _, offsets, content = texts.buffers()
    if not len(texts) or offsets is None or content is None:
        return pa.array(np.zeros(len(texts), np.int64))
    bounds = np.frombuffer(offsets, np.int32)[texts.offset :][: len(texts) + 1]
    data = np.frombuffer(content, np.uint8)[bounds[0] : bounds[-1]]
    # Bytes 9 to 13 and 28 to 32 are spaces; what is less than the first one becomes large.
    inside = (data - np.uint8(9) > 4) & (data - np.uint8(28) > 4)
    begins = inside.copy()
    begins[1:] &= ~inside[:-1]
    first = bounds[:-1][bounds[:-1] < bounds[1:]] - bounds[0]
    begins[first] = inside[first]
    before = np.searchsorted(np.flatnonzero(begins), bounds - bounds[0])
    return pa.array(np.diff(before).astype(np.int64))
