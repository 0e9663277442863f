"""The one deduplication, and the one way rows get into buckets."""

from __future__ import annotations

import zlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from kb.store.tables.latest import duplicates, newest
from kb.store.tables.partition import Shuffle

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


def test_rows_of_a_key_meet_in_one_bucket_in_their_order(tmp_path: Path) -> None:
    keys = [f"k{n % 37}" if n % 11 else None for n in range(500)]
    rows = pa.table({"key": pa.array(keys, pa.string()), "n": range(500)})
    with Shuffle(tmp_path, "x", 8) as shuffle:
        for start in range(0, 500, 90):
            part = rows.slice(start, 90)
            shuffle.write(part, part["key"])
    found = 0
    for path in tmp_path.glob("*/x.arrow"):
        with pa.ipc.open_file(str(path)) as file:
            part = file.read_all().to_pydict()
        assert part["n"] == sorted(part["n"])
        found += len(part["n"])
        # The same hash on every machine, so workers of a cluster agree.
        numbers = {zlib.crc32((key or "None").encode()) % 8 for key in part["key"]}
        assert numbers == {int(path.parent.name)}
    assert found == 500
