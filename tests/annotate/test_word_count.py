"""Word counts equal those of str.split."""

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate.word_count import word_count

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=60)


SPACES = " \t\n\x0b\x0c\x1c\x1f\x85\xa0\u2003\u2028\u3000\u200b"  # the last one is none for Python


SPACED = st.lists(st.sampled_from([*SPACES, "a", "bc", "é"]), max_size=30).map("".join)


@given(st.lists(st.none() | TEXT | SPACED, max_size=12), st.integers(0, 3))
def test_words_are_those_of_str_split(texts, start):
    expected = [len((text or "").split()) for text in texts]
    column = pa.array(texts, pa.string())
    assert word_count(column).to_pylist() == expected
    assert word_count(column.slice(start)).to_pylist() == expected[start:]
