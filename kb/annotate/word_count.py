"""Word counts of text columns, vectorised."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

# Unicode white space (str.isspace, str.split): RE2's \s knows only the ASCII part.
_WORD = r"[^\s\x0b\x1c-\x1f\x{85}\p{Z}]+"
_ASCII_WORD = r"[^\t-\r\x1c-\x1f ]+"
_OTHER_SPACE = r"[\x{85}\x{a0}\x{1680}\x{2000}-\x{200a}\x{2028}\x{2029}\x{202f}\x{205f}\x{3000}]"
_LEADS = b"\xc2\xe1\xe2\xe3"  # first bytes of each of these
_OTHER_SPACES = b"\t\n\v\f\r\x1c\x1d\x1e\x1f"


def word_count_of_lists(lists: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """Words of all texts in each list together, int64; null for a null list, 0 for an empty one."""
    if isinstance(lists, pa.ChunkedArray):
        lists = lists.combine_chunks()
    texts = pc.list_flatten(lists).cast(pa.string())
    if texts.null_count:
        texts = pc.fill_null(texts, "")
    totals = _of_runs(texts, pc.fill_null(pc.list_value_length(lists), 0).cast(pa.int64()))
    odd = _holding_other_spaces(texts)
    if pc.any(odd).as_py():
        few = texts.filter(odd)
        beyond = pc.subtract(_by_regex(few), pc.count_substring_regex(few, _ASCII_WORD))
        of = pc.list_parent_indices(lists).cast(pa.int64()).filter(odd)
        totals = pc.add(totals, _summed(of, beyond.cast(pa.int64()), len(lists)))
    words: pa.Array[Any] = pc.if_else(pc.is_valid(lists), totals, pa.scalar(None, pa.int64()))
    return words


def _by_regex(texts: pa.Array[Any]) -> pa.Array[Any]:
    words: pa.Array[Any] = pc.count_substring_regex(texts, _WORD)
    return words


def _holding_other_spaces(texts: pa.Array[Any]) -> pa.Array[Any]:
    """Texts that hold white space beyond ASCII."""
    data = texts.buffers()[2]
    raw = memoryview(data).tobytes() if data is not None else b""
    if not any(lead in raw for lead in _LEADS):
        return pa.repeat(pa.scalar(False), len(texts))
    odd: pa.Array[Any] = pc.invert(pc.string_is_ascii(texts))
    if pc.any(odd).as_py():
        odd = pc.replace_with_mask(
            odd, odd, pc.match_substring_regex(texts.filter(odd), _OTHER_SPACE)
        )
    return odd


def _of_runs(texts: pa.Array[Any], sizes: pa.Array[Any]) -> pa.Array[Any]:
    """Words of runs of `sizes` texts, as if there were no white space beyond ASCII.

    A word begins where a byte is none of white space and the one before it is, or it is a text's
    first: both are a bit a byte or a text, and bits are counted by the word.
    """
    _, offsets, data = texts.buffers()
    if data is None or not pc.any(pc.not_equal(texts, "")).as_py():
        return pa.repeat(pa.scalar(0, pa.int64()), len(sizes))
    at = pa.Array.from_buffers(pa.int32(), texts.offset + len(texts) + 1, [None, offsets])
    at = at.slice(texts.offset)
    first, after = at[0].as_py(), at[-1].as_py()
    # A space before all: so the byte before any byte has the byte's own place.
    raw = b" " + memoryview(data)[first:after]
    every = pa.Array.from_buffers(pa.uint8(), len(raw), [None, pa.py_buffer(raw)])
    space = pc.equal(every, pa.scalar(ord(" "), pa.uint8()))
    for other in _OTHER_SPACES:
        if other in raw:
            space = pc.or_(space, pc.equal(every, pa.scalar(other, pa.uint8())))
    begins = pc.and_not(space.slice(0, after - first), space.slice(1))
    at = pc.subtract(at, first)
    # Texts that begin without a space between them and the text before.
    place = at.slice(0, len(texts))
    held = pc.less(place, at.slice(1))
    place = pc.if_else(held, place, 0)
    joined = pc.and_not(held, pc.or_(pc.take(space, place), pc.take(space, pc.add(place, 1))))
    runs = [0, *pc.cumulative_sum(sizes).to_pylist()]
    ends = at.take(pa.array(runs, pa.int64())).to_pylist()
    counts = [
        begins.slice(a, b - a).true_count + joined.slice(c, d - c).true_count
        for (a, b), (c, d) in zip(pairwise(ends), pairwise(runs), strict=True)
    ]
    return pa.array(counts, pa.int64())


def _summed(of: pa.Array[Any], numbers: pa.Array[Any], size: int) -> pa.Array[Any]:
    """The sum of the numbers of each of `size` rows; `of` says whose each is."""
    sums = pa.table({"row": of, "n": numbers}).group_by("row").aggregate([("n", "sum")])
    places = pc.index_in(pa.array(range(size), pa.int64()), value_set=sums["row"].combine_chunks())
    whole: pa.Array[Any] = pc.fill_null(sums["n_sum"].combine_chunks().take(places), 0)
    return whole
