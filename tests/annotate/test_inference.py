"""Words, hashes, windows and batches: properties that hold for every text."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.annotate.inference import batches, largest, padded_length, windows


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
