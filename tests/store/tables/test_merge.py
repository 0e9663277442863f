"""Tests of `kb.store.tables.merge`."""

import random
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from kb.store.tables import merge, shard_writer
from tests.store.tables.test_shard_writer import CELLS, REJECTED, cells, rejected


@pytest.mark.parametrize("layout", [1, 3, 40])
def test_sorted_shards_whatever_the_parts(tmp_path: Path, layout: int) -> None:
    keys = [f"k{number:05d}" for number in range(20_000)]
    parts = [tmp_path / f"part-{index:05d}.parquet" for index in range(layout)]
    for index, path in enumerate(parts):
        shard_writer.write_table(path, rejected(keys[index::layout]), REJECTED)
    whole = tmp_path / "whole.parquet"
    shard_writer.write_table(whole, rejected(keys), REJECTED)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    made = shard_writer.sorted_shards(
        parts, tmp_path / "a", REJECTED, shard_bytes=1, group_rows=7_000, released=False
    )
    shard_writer.sorted_shards(
        [whole], tmp_path / "b", REJECTED, shard_bytes=1, group_rows=7_000, released=False
    )
    assert [shard.path.name for shard in made] == [
        f"rejected-{i:05d}-of-00003.parquet" for i in range(3)
    ]
    assert [shard.rows for shard in made] == [7_000, 7_000, 6_000]
    read = [key for shard in made for key in pq.read_table(shard.path)["key"].to_pylist()]
    assert read == keys
    for shard in made:
        assert shard.path.read_bytes() == (tmp_path / "b" / shard.path.name).read_bytes()


def test_a_group_larger_than_what_is_read_ahead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(merge, "ROWS_AHEAD", 8)
    monkeypatch.setattr(merge, "_LEAST", 2)
    rows = [
        (page, 1, row, column)
        for page in (1, 2, 3, 9)
        for row in range(100 if page == 2 else 3)
        for column in range(2)
    ]
    random.Random(2).shuffle(rows)
    parts = [tmp_path / f"{index}.parquet" for index in range(3)]
    for index, path in enumerate(parts):
        shard_writer.write_table(path, cells(rows[index::3]), CELLS)
    with_unsorted = tmp_path / "unsorted.parquet"
    more = [(2, 2, 5, 5), (1, 2, 5, 5)]
    with shard_writer.ShardWriter(with_unsorted, CELLS) as writer:
        writer.add_rows(cells(more))
    (tmp_path / "out").mkdir()
    made = shard_writer.sorted_shards([*parts, with_unsorted], tmp_path / "out", CELLS)
    read = (
        pq.read_table(made[0].path)
        .select(["page_id", "table_id", "row_index", "column_index"])
        .to_pylist()
    )
    assert [tuple(row.values()) for row in read] == sorted(rows + more)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_rows_of_a_second_table_by_key() -> None:
    rows = merge.RowsByKey(iter([{"k": 1, "v": "a"}, {"k": 3, "v": "b"}, {"k": 3, "v": "c"}]), "k")
    assert [[row["v"] for row in rows.rows_of(key)] for key in (0, 1, 2, 3, 4)] == [
        [],
        ["a"],
        [],
        ["b", "c"],
        [],
    ]
