"""Words, hashes, windows and batches: properties that hold for every text."""

from __future__ import annotations

import hashlib

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate.batches import batches, padded_length
from kb.annotate.hashes import text_hashes
from kb.annotate.windows import largest, windows
from kb.annotate.words import word_count_of_lists

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


@given(st.lists(st.none() | TEXT, max_size=8))
def test_hashes_are_sha256_of_utf8_and_null_for_nothing(texts):
    expected = [hashlib.sha256(text.encode()).hexdigest() if text else None for text in texts]
    assert text_hashes(pa.array(texts, pa.string())).to_pylist() == expected


@given(st.integers(0, 2000), st.integers(3, 600))
def test_windows_hold_every_token_once_and_fit(length, size):
    ids = list(range(length))
    found = windows(ids, size)
    assert [token for window in found for token in window] == ids
    assert all(len(window) <= size - 2 for window in found)
    assert len(found) == max(1, -(-length // (size - 2)))


def test_the_largest_of_a_texts_windows_counts():
    assert largest([[0.1, 0.9], [0.5, 0.2], [0.3, 0.3]], [0, 0, 1], 2) == [[0.5, 0.9], [0.3, 0.3]]
    with pytest.raises(ValueError, match="no window"):
        largest([[0.1]], [0], 2)


@given(st.lists(st.integers(1, 512), max_size=200), st.integers(64, 4096))
def test_batches_hold_each_window_once_within_the_budget(lengths, budget):
    seen: list[int] = []
    widths = []
    for width, numbers in batches(lengths, budget):
        seen += numbers
        widths.append(width)
        assert all(padded_length(lengths[number]) == width >= lengths[number] for number in numbers)
        assert len(numbers) == 1 or width * len(numbers) <= budget
    assert sorted(seen) == list(range(len(lengths)))
    assert widths == sorted(widths)
    assert list(batches(lengths, budget)) == list(batches(lengths, budget))
