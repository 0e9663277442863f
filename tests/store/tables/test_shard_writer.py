"""Parquet as it is written: settings, order, wholeness, and bytes that depend on the rows alone."""

import random
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import SchemaMismatch
from kb.schema import table
from kb.store.tables import shard_writer

REJECTED = table("shared/rejected")
CELLS = table("wiki/cells")


def rejected(keys: list[str]) -> pa.Table:
    return pa.table(
        {
            "key": keys,
            "stage": ["views"] * len(keys),
            "reason": ["below"] * len(keys),
            "value": [str(len(key)) if key[-1] != "0" else None for key in keys],
            "threshold": ["100"] * len(keys),
            **{
                name: pa.nulls(len(keys), REJECTED.arrow().field(name).type)
                for name in REJECTED.names()[5:]
            },
        }
    )


def cells(rows: list[tuple[int, int, int, int]]) -> pa.Table:
    columns = list(zip(*rows, strict=True))
    data: dict[str, object] = {
        name: columns[i]
        for i, name in enumerate(["page_id", "table_id", "row_index", "column_index"])
    }
    size = len(rows)
    data |= {
        "element_id": [1] * size,
        "row_span": [1] * size,
        "column_span": [1] * size,
        "is_header": [False] * size,
        "text": [f"{row}" for row in rows],
    }
    data |= {name: [0.5] * size for name in ("x", "y", "width", "height")}
    return pa.table(data)


def test_settings_of_a_written_file(tmp_path: Path) -> None:
    rows = rejected([f"k{number:07d}" for number in range(shard_writer.ROW_GROUP + 10)])
    shard_writer.write_table(tmp_path / "a.parquet", rows, REJECTED)
    about = pq.read_metadata(tmp_path / "a.parquet")
    assert [about.row_group(i).num_rows for i in range(about.num_row_groups)] == [131_072, 10]
    chunks = {
        about.row_group(0).column(i).path_in_schema: about.row_group(0).column(i)
        for i in range(about.num_columns)
    }
    assert {chunk.compression for chunk in chunks.values()} == {"ZSTD"}
    assert all(
        chunk.is_stats_set and chunk.has_column_index and chunk.has_offset_index
        for chunk in chunks.values()
    )
    assert "RLE_DICTIONARY" in chunks["stage"].encodings
    assert "RLE_DICTIONARY" not in chunks["key"].encodings
    schema = pq.read_schema(tmp_path / "a.parquet")
    assert schema.field("key").metadata[b"doc"]
    assert not schema.field("key").nullable


def test_rows_are_sorted_and_bytes_follow_from_them_alone(tmp_path: Path) -> None:
    keys = [f"k{number:05d}" for number in range(5000)]
    shuffled = keys[:]
    random.Random(1).shuffle(shuffled)
    shard_writer.write_table(tmp_path / "a.parquet", rejected(keys), REJECTED)
    shard_writer.write_table(tmp_path / "b.parquet", rejected(shuffled), REJECTED)
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_pieces_of_any_size_give_the_same_file(tmp_path: Path) -> None:
    rows = rejected([f"k{number:07d}" for number in range(200_000)])
    for name, step in (("one", 200_000), ("odd", 33_333)):
        with shard_writer.ShardWriter(tmp_path / name, REJECTED, in_order=True) as writer:
            for start in range(0, rows.num_rows, step):
                writer.add_rows(rows.slice(start, step))
    assert (tmp_path / "one").read_bytes() == (tmp_path / "odd").read_bytes()


def test_a_failed_write_leaves_nothing(tmp_path: Path) -> None:
    with (
        pytest.raises(RuntimeError),
        shard_writer.ShardWriter(tmp_path / "a.parquet", REJECTED) as writer,
    ):
        writer.add_rows(rejected(["a"]))
        raise RuntimeError
    with (
        pytest.raises(SchemaMismatch),
        shard_writer.ShardWriter(tmp_path / "a.parquet", REJECTED) as writer,
    ):
        writer.add_rows(pa.table({"key": ["a"]}))
    assert list(tmp_path.iterdir()) == []


def test_columns_are_derived_on_the_way(tmp_path: Path) -> None:
    part = tmp_path / "part.parquet"
    shard_writer.write_table(part, cells([(1, 1, 0, 0), (2, 1, 0, 0)]), CELLS)

    def shout(rows: pa.Table) -> pa.Table:
        return rows.set_column(
            rows.column_names.index("text"), "text", pa.array(["X"] * rows.num_rows)
        )

    (tmp_path / "out").mkdir()
    made = shard_writer.sorted_shards([part], tmp_path / "out", CELLS, change=shout)
    assert pq.read_table(made[0].path)["text"].to_pylist() == ["X", "X"]


def test_a_shard_ends_with_the_row_group_that_reaches_its_size(tmp_path: Path) -> None:
    part = tmp_path / "part.parquet"
    shard_writer.write_table(part, cells([(1, 2, n, 0) for n in range(1_000)]), CELLS)
    sizes = {}
    for shard_bytes in (1, 4_000, 10**9):
        out = tmp_path / str(shard_bytes)
        out.mkdir()
        made = shard_writer.sorted_shards(
            [part], out, CELLS, shard_bytes=shard_bytes, group_rows=90
        )
        sizes[shard_bytes] = [shard.rows for shard in made]
        assert sorted(path.name for path in out.iterdir()) == [
            f"cells-{at:05d}-of-{len(made):05d}.parquet" for at in range(len(made))
        ]
        for shard in made[:-1]:
            last = pq.read_metadata(shard.path).row_group(shard.rows // 90 - 1).column(0)
            begins = last.dictionary_page_offset or last.data_page_offset
            assert shard.path.stat().st_size >= shard_bytes
            assert begins < max(shard_bytes, 10), "no group is added to a full shard"
    assert sizes[1] == [90] * 11 + [10]
    assert 2 < len(sizes[4_000]) < 12
    assert sizes[10**9] == [1_000]


def test_no_rows_still_give_a_table(tmp_path: Path) -> None:
    made = shard_writer.sorted_shards([], tmp_path, table("youtube/videos"))
    assert [shard.path.name for shard in made] == ["videos-00000-of-00001.parquet"]
    assert pq.read_schema(made[0].path).names == table("youtube/videos").names(released=True)
