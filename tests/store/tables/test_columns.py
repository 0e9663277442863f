"""Operations on columns that Arrow lacks."""

import pyarrow as pa

from kb.store.tables.columns import aligned, lists, put


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
