"""Rows of purged keys leave the files of tables; a dry run counts the same."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.artifacts.purge_rows import RowLocation, drop_rows
from kb.core.errors import DamagedData

POSTS = RowLocation("clean/reddit/posts", "reddit/posts", "post_id", "t3_")
LINKS = RowLocation("links", "links/links", "key", source="reddit")
ids = st.sampled_from(["a", "b", "c"])


@given(st.lists(ids), st.sets(ids))
def test_rows_match_by_prefix_and_source(values: list[str], keys: set[str]) -> None:
    rows = pa.RecordBatch.from_pydict({"post_id": pa.array(values, pa.string())})
    mask = POSTS.matches(rows, POSTS.values({f"t3_{key}" for key in keys} | {"t1_a"}))
    assert mask.to_pylist() == [value in keys for value in values]
    sources = ["reddit", "wiki"] * len(values)
    rows = pa.RecordBatch.from_pydict(
        {"key": pa.array(values * 2, pa.string()), "source": sources[: 2 * len(values)]}
    )
    mask = LINKS.matches(rows, LINKS.values(keys))
    assert [bool(one) for one in mask.to_pylist()] == [
        value in keys and source == "reddit"
        for value, source in zip(values * 2, sources, strict=False)
    ]


def test_a_dry_run_counts_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "links" / "links-00000.parquet"
    path.parent.mkdir()
    pq.write_table(pa.table({"key": ["a", "b", "a"], "source": ["wiki", "reddit", "reddit"]}), path)
    before = path.read_bytes()
    lines = [("links", "links/links", 1)]
    assert list(drop_rows(tmp_path, [LINKS], ["a"], dry=True)) == lines
    assert list(drop_rows(tmp_path, [LINKS], ["c"])) == [("links", "links/links", 0)]
    assert path.read_bytes() == before


def test_tables_of_an_older_version_lack_columns(tmp_path: Path, make_rows: Any) -> None:
    path = tmp_path / "clean" / "youtube" / "rejected" / "part-00000.parquet"
    path.parent.mkdir(parents=True)
    rows = make_rows("shared/rejected", 3).drop_columns(["number", "other_stages"])
    pq.write_table(rows, path)
    key = rows["key"][0].as_py()
    location = RowLocation("clean/youtube/rejected", "shared/rejected", "key")
    lines = list(drop_rows(tmp_path, [location], [key]))
    assert lines == [("clean/youtube/rejected", "shared/rejected", 1)]
    kept = pq.read_table(path)
    assert kept.select(rows.column_names).to_pylist() == rows.slice(1).to_pylist()
    assert kept["number"].null_count == kept["other_stages"].null_count == 2


@pytest.mark.parametrize("how", ["empty", "cut"])
def test_a_damaged_table_is_not_an_empty_one(tmp_path: Path, how: str) -> None:
    path = tmp_path / "clean" / "reddit" / "posts" / "part-00000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table({"post_id": ["a"] * 5_000}), path)
    path.write_bytes(b"" if how == "empty" else path.read_bytes()[:-9])
    with pytest.raises(DamagedData, match=f"{path} can't be read"):
        list(drop_rows(tmp_path, [POSTS], ["t3_a"]))
