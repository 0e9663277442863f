"""Tests of `kb.store.tables.row_counts`."""

from datetime import UTC, datetime
from pathlib import Path

import pyarrow as pa

from kb.store.tables import parquet, row_counts


def test_rows_are_counted_from_the_footers_of_all_files(tmp_path: Path) -> None:
    for number, keys in enumerate((["a", "b"], ["c"])):
        parquet.write_file(tmp_path / f"part-{number:05d}.parquet", pa.table({"key": keys}))
    assert row_counts.rows(tmp_path) == 3
    assert row_counts.rows(tmp_path / "missing") == 0


def test_tables_without_rows_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "videos").mkdir()
    parquet.write_file(tmp_path / "videos/part-00000.parquet", pa.table({"key": ["a", "b"]}))
    answers = row_counts.tally(tmp_path, {"videos": "video:", "comments": "comment:"})
    assert list(answers) == ["videos"]
    assert (answers["videos"]["crawled"], answers["videos"]["kept"]) == (2, 2)


def test_keys_of_verdicts_count_for_the_table_that_they_begin_like(tmp_path: Path) -> None:
    (tmp_path / "rejected").mkdir()
    keys, stages = ["t3_a", "t1_b", "t1_c"], ["missing", "removed", "missing"]
    parquet.write_file(tmp_path / "rejected/a.parquet", pa.table({"key": keys, "stage": stages}))
    answers = row_counts.tally(tmp_path, {"posts": "t3_", "comments": "t1_"})
    assert {name: (one["rejected"], one["missing"]) for name, one in answers.items()} == {
        "posts": (1, 1),
        "comments": (2, 1),
    }


def test_the_span_of_times_and_how_many_are_old(tmp_path: Path) -> None:
    times = [datetime(2026, 1, day, tzinfo=UTC) for day in (3, 1, 2)]
    kind = pa.timestamp("us", "UTC")
    parquet.write_file(
        tmp_path / "a.parquet", pa.table({"fetched_at": pa.array([*times, None], kind)})
    )
    parquet.write_file(tmp_path / "b.parquet", pa.table({"other": [1]}))
    files = sorted(tmp_path.iterdir())
    assert row_counts.span(files, "fetched_at", times[0]) == (times[1], times[0], 2)
    assert row_counts.span(files[1:], "fetched_at", times[0]) == (None, None, 0)
