"""Operations on columns that Arrow lacks: the one deduplication, words as str.split counts them."""

from itertools import pairwise
from typing import Any

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.store.tables.columns import aligned, duplicates, lists, newest, put, word_count

TYPES = {"key": pa.string(), "other": pa.int64(), "at": pa.int64(), "n": pa.int64()}
ROW = st.tuples(
    st.sampled_from([None, "a", "b", "c"]),
    st.sampled_from([None, 1, 2]),
    st.sampled_from([None, 1, 2, 3]),
)

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=60)


SPACES = " \t\n\x0b\x0c\x1c\x1f\x85\xa0\u2003\u2028\u3000\u200b"  # the last one is none for Python


SPACED = st.lists(st.sampled_from([*SPACES, "a", "bc", "é"]), max_size=30).map("".join)


def test_rows_follow_the_keys_and_a_key_without_a_row_has_nulls() -> None:
    rows = pa.table({"key": pa.chunked_array([["a"], ["b"]]), "n": [1, 2]})
    for keys in (pa.array(["b", "x", "a"]), pa.chunked_array([["b", "x"], ["a"]])):
        assert aligned(rows, "key", keys)["n"].to_pylist() == [2, None, 1]
        empty = aligned(rows.slice(0, 0), "key", keys)
        assert (empty.schema, empty["n"].to_pylist()) == (rows.schema, [None] * 3)


def test_a_column_is_replaced_in_its_place_or_added() -> None:
    rows = put(pa.table({"a": [1], "b": [2]}), "a", pa.array(["x"]))
    assert put(rows, "c", pa.array([3])).to_pylist() == [{"a": "x", "b": 2, "c": 3}]


def test_lists_of_given_lengths() -> None:
    made = lists(pa.array([2, None, 0, 1], pa.int64()), pa.array("xyz"))
    assert made.to_pylist() == [["x", "y"], [], [], ["z"]]
    assert lists(pa.array([], pa.int64()), pa.array([], pa.string())).to_pylist() == []


def made(rows: list[tuple[Any, ...]], cuts: list[int]) -> pa.Table:
    """Rows with their number `n`, in pieces, as they come from several segments."""
    columns = list(zip(*[(*row, n) for n, row in enumerate(rows)], strict=True)) or [()] * 4
    whole = pa.table(
        [pa.array(values, kind) for values, kind in zip(columns, TYPES.values(), strict=True)],
        names=list(TYPES),
    )
    bounds = sorted({0, len(rows), *(cut % (len(rows) + 1) for cut in cuts)})
    pieces = [whole.slice(a, b - a) for a, b in pairwise(bounds)]
    return pa.concat_tables(pieces) if pieces else whole


@given(st.lists(ROW, max_size=60), st.lists(st.integers(0, 60), max_size=4))
def test_the_last_of_the_greatest_stays(rows: list[tuple[Any, ...]], cuts: list[int]) -> None:
    best: dict[Any, tuple[Any, int]] = {}
    for n, (key, other, at) in enumerate(rows):
        # A null is equal to no other key, so each such row is one of its own.
        name = (key, other) if key is not None and other is not None else (key, other, n)
        rank = -1 if at is None else at
        if name not in best or best[name][0] <= rank:
            best[name] = (rank, n)
    kept = newest(made(rows, cuts), ["key", "other"], ["at"])
    assert sorted(kept["n"].to_pylist()) == sorted(n for _, n in best.values())
    keys = [(row["key"] or "", row["other"] or 0) for row in kept.to_pylist()]
    assert keys == sorted(keys)


def test_without_a_key_one_row_stays() -> None:
    rows = made([("a", 1, 2), ("b", 2, 3), ("c", 1, 3), ("a", 1, 1)], [2])
    assert newest(rows, [], ["at"])["n"].to_pylist() == [2]
    assert newest(rows.slice(0, 0), [], ["at"]).num_rows == 0


def test_echoes_are_no_duplicates() -> None:
    rows = made([("a", 1, 1), ("a", 1, 2), ("b", 1, 1), ("b", 1, 2)], [])
    rows = rows.append_column("echo", pa.array([False, False, True, True]))
    kept = newest(rows, ["key"], ["at"])
    assert duplicates(rows, kept) == 2
    assert duplicates(rows, kept, "echo") == 1


@given(st.lists(st.none() | TEXT | SPACED, max_size=12), st.integers(0, 3))
def test_words_are_those_of_str_split(texts, start):
    expected = [len((text or "").split()) for text in texts]
    column = pa.array(texts, pa.string())
    assert word_count(column).to_pylist() == expected
    assert word_count(column.slice(start)).to_pylist() == expected[start:]
