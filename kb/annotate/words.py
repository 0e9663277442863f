"""Word counts of text columns, vectorised."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

# Unicode white space (str.isspace, str.split): RE2's \s knows only the ASCII part.
_WORD = r"[^\s\x0b\x1c-\x1f\x{85}\p{Z}]+"
_OTHER_SPACES = b"\t\n\v\f\r\x1c\x1d\x1e\x1f"
_SPACED = bytes.maketrans(_OTHER_SPACES, b" " * len(_OTHER_SPACES))


def word_count(texts: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any] | pa.ChunkedArray[Any]:
    """Whitespace-separated words of each text, int64; null stays null.

    Equal to `len(text.split())` for every text.
    """
    texts = texts.cast(pa.string())
    if isinstance(texts, pa.ChunkedArray):
        return pa.chunked_array([_counted(chunk) for chunk in texts.chunks], pa.int64())
    return _counted(texts)


def _counted(texts: pa.Array[Any]) -> pa.Array[Any]:
    """One more than the spaces; where spaces don't stand alone between words, by the regex."""
    if not len(texts):
        return pa.array([], pa.int64())
    spaced = _spaced(texts)
    counts, odd = _naive(spaced), _odd(spaced)
    if not pc.any(odd).as_py():
        return counts
    words: pa.Array[Any] = pc.replace_with_mask(counts, odd, _by_regex(texts.filter(odd)))
    return words


def _by_regex(texts: pa.Array[Any]) -> pa.Array[Any]:
    words: pa.Array[Any] = pc.count_substring_regex(texts, _WORD).cast(pa.int64())
    return words


def _naive(spaced: pa.Array[Any]) -> pa.Array[Any]:
    words: pa.Array[Any] = pc.add(pc.count_substring(spaced, " "), 1).cast(pa.int64())
    return words


def _odd(spaced: pa.Array[Any]) -> pa.Array[Any]:
    """Texts whose words are not one more than their spaces, or may not be."""
    odd = pc.invert(pc.string_is_ascii(spaced))
    data = spaced.buffers()[2]
    if data is not None and b"  " in data.to_pybytes():
        odd = pc.or_(odd, pc.match_substring(spaced, "  "))
    for end in (pc.starts_with(spaced, " "), pc.ends_with(spaced, " "), pc.equal(spaced, "")):
        odd = pc.or_(odd, end)
    whole: pa.Array[Any] = pc.fill_null(odd, False)
    return whole


def _spaced(texts: pa.Array[Any]) -> pa.Array[Any]:
    """The texts with plain spaces for other white space of ASCII: a byte is a byte."""
    valid, offsets, data = texts.buffers()
    raw = data.to_pybytes() if data is not None else b""
    if offsets is None or not any(byte in raw for byte in _OTHER_SPACES):
        return texts
    whole = pa.py_buffer(raw.translate(_SPACED))
    return pa.StringArray.from_buffers(len(texts), offsets, whole, valid, -1, texts.offset)


def word_count_of_lists(lists: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Array[Any]:
    """Words of all texts in each list together, int64; null for a null list, 0 for an empty one."""
    if isinstance(lists, pa.ChunkedArray):
        lists = lists.combine_chunks()
    texts = pc.fill_null(pc.list_flatten(lists).cast(pa.string()), "")
    sizes = pc.fill_null(pc.list_value_length(lists), 0).cast(pa.int64())
    if len(texts):
        spaced = _spaced(texts)
        totals, odd = _naive_totals(spaced, sizes), _odd(spaced)
        if pc.any(odd).as_py():
            few = texts.filter(odd)
            more = pc.subtract(_by_regex(few), _naive(spaced.filter(odd)))
            of = pc.list_parent_indices(lists).cast(pa.int64()).filter(odd)
            totals = pc.add(totals, _summed(of, more, len(lists)))
    else:
        totals = sizes
    words: pa.Array[Any] = pc.if_else(pc.is_valid(lists), totals, pa.scalar(None, pa.int64()))
    return words


def _naive_totals(spaced: pa.Array[Any], sizes: pa.Array[Any]) -> pa.Array[Any]:
    """`_naive` of runs of `sizes` texts, together: a count of bytes for each run."""
    _, offsets, data = spaced.buffers()
    at = pa.Array.from_buffers(pa.int32(), spaced.offset + len(spaced) + 1, [None, offsets])
    last = pc.add(pc.cumulative_sum(sizes), spaced.offset)
    ends = [at[spaced.offset].as_py(), *at.take(last).to_pylist()]
    whole = data.to_pybytes() if data is not None else b""
    spaces = [whole.count(b" ", first, after) for first, after in pairwise(ends)]
    totals: pa.Array[Any] = pc.add(pa.array(spaces, pa.int64()), sizes)
    return totals


def _summed(of: pa.Array[Any], numbers: pa.Array[Any], size: int) -> pa.Array[Any]:
    """The sum of the numbers of each of `size` rows; `of` says whose each is."""
    sums = pa.table({"row": of, "n": numbers}).group_by("row").aggregate([("n", "sum")])
    places = pc.index_in(pa.array(range(size), pa.int64()), value_set=sums["row"].combine_chunks())
    whole: pa.Array[Any] = pc.fill_null(sums["n_sum"].combine_chunks().take(places), 0)
    return whole
