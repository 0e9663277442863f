"""Count the words of texts."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

# What `str.split` takes for white space beyond the six spaces of ASCII that Arrow knows
_OTHER_SPACES = (
    r"[\x1c-\x1f\x{85}\x{a0}\x{1680}\x{2000}-\x{200a}\x{2028}\x{2029}\x{202f}\x{205f}\x{3000}]"
)


def word_count(texts: pa.Array[Any]) -> pa.Array[Any]:
    """Words of each text, as `str.split` separates them (int64); 0 for null."""
    texts = pc.fill_null(texts.cast(pa.string()), "")
    # Splitting at ASCII's spaces takes half the time of splitting at those of Unicode.
    texts = pc.ascii_trim_whitespace(pc.replace_substring_regex(texts, _OTHER_SPACES, " "))
    words = pc.list_value_length(pc.ascii_split_whitespace(texts)).cast(pa.int64())
    return pc.if_else(pc.equal(texts, ""), 0, words)
