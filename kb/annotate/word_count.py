"""Count the words in text columns."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc


def word_count_of_lists(lists: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """Words, as `str.split` separates them, of all texts in each list together (int64).

    Null for a null list, 0 for an empty one.
    """
    if isinstance(lists, pa.ChunkedArray):
        lists = lists.combine_chunks()
    texts = pc.utf8_trim_whitespace(pc.fill_null(pc.list_flatten(lists).cast(pa.string()), ""))
    words = pc.list_value_length(pc.utf8_split_whitespace(texts)).cast(pa.int64())
    words = pc.if_else(pc.equal(texts, ""), 0, words)
    totals = pa.concat_arrays([pa.array([0], pa.int64()), pc.cumulative_sum(words)])
    lengths = pc.fill_null(pc.list_value_length(lists), 0).cast(pa.int64())
    ends = pc.cumulative_sum(lengths)
    counts = pc.subtract(totals.take(ends), totals.take(pc.subtract(ends, lengths)))
    return pc.if_else(pc.is_valid(lists), counts, pa.scalar(None, pa.int64()))
