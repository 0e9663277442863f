"""The one deduplication, and the one way rows get into buckets."""

from itertools import pairwise
from typing import Any

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.store.tables.latest import duplicates, newest

TYPES = {"key": pa.string(), "other": pa.int64(), "at": pa.int64(), "n": pa.int64()}
ROW = st.tuples(
    st.sampled_from([None, "a", "b", "c"]),
    st.sampled_from([None, 1, 2]),
    st.sampled_from([None, 1, 2, 3]),
)


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
