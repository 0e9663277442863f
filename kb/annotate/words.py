"""Word counts of text columns, vectorised."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

# Unicode white space (str.isspace, str.split): RE2's \s knows only the ASCII part.
_WORD = r"[^\s\x0b\x1c-\x1f\x{85}\p{Z}]+"


def word_count(texts: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any] | pa.ChunkedArray[Any]:
    """Whitespace-separated words of each text, int64; null stays null.

    Equal to `len(text.split())` for every text.
    """
    counts: pa.Array[Any] | pa.ChunkedArray[Any] = pc.count_substring_regex(
        texts.cast(pa.string()), _WORD
    ).cast(pa.int64())
    return counts


def word_count_of_lists(lists: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """Words of all texts in each list together, int64; null for a null list, 0 for an empty one."""
    if isinstance(lists, pa.ChunkedArray):
        lists = lists.combine_chunks()
    counts = pc.fill_null(word_count(pc.list_flatten(lists)), 0)
    sums = (
        pa.table({"row": pc.list_parent_indices(lists).cast(pa.int64()), "n": counts})
        .group_by("row")
        .aggregate([("n", "sum")])
    )
    found = pc.index_in(
        pa.array(range(len(lists)), pa.int64()), value_set=sums["row"].combine_chunks()
    )
    totals = pc.fill_null(sums["n_sum"].combine_chunks().take(found), 0)
    words: pa.Array[Any] = pc.if_else(pc.is_valid(lists), totals, pa.scalar(None, pa.int64()))
    return words
