"""Tests of `kb.store.tables.row_counts`."""

from pathlib import Path

import pyarrow as pa

from kb.store.tables import parquet, row_counts


def test_rows_are_counted_from_the_footers_of_all_files(tmp_path: Path) -> None:
    for number, keys in enumerate((["a", "b"], ["c"])):
        parquet.write(tmp_path / f"part-{number:05d}.parquet", pa.table({"key": keys}))
    assert row_counts.rows(tmp_path) == 3
    assert row_counts.rows(tmp_path / "missing") == 0


def test_tables_without_rows_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "videos").mkdir()
    parquet.write(tmp_path / "videos/part-00000.parquet", pa.table({"key": ["a", "b"]}))
    answers = row_counts.tally(tmp_path, {"videos": "video:", "comments": "comment:"})
    assert list(answers) == ["videos"]
    assert (answers["videos"]["crawled"], answers["videos"]["kept"]) == (2, 2)
