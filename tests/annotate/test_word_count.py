"""Word counts equal those of str.split."""

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate.word_count import word_count_of_lists

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=60)


SPACES = " \t\n\x0b\x0c\x1c\x1f\x85\xa0\u2003\u2028\u3000\u200b"  # the last one is none for Python


SPACED = st.lists(st.sampled_from([*SPACES, "a", "bc", "é"]), max_size=30).map("".join)


@given(st.lists(TEXT | SPACED, max_size=12))
def test_words_are_those_of_str_split(texts):
    expected = [len(text.split()) for text in texts]
    each = pa.array([[text] for text in texts], pa.list_(pa.string()))
    assert word_count_of_lists(each).to_pylist() == expected


@given(
    st.lists(st.none() | st.lists(st.none() | TEXT | SPACED, max_size=4), max_size=8),
    st.integers(0, 3),
)
def test_words_of_lists_are_the_sum_over_each_list(lists, start):
    expected = [
        None if texts is None else sum(len((text or "").split()) for text in texts)
        for texts in lists
    ]
    column = pa.array(lists, pa.list_(pa.string()))
    assert word_count_of_lists(column).to_pylist() == expected
    assert word_count_of_lists(column.slice(start)).to_pylist() == expected[start:], (
        "a slice knows where it begins"
    )
