"""Tests of `kb.export.rows`."""

import json
from pathlib import Path

import pytest

from kb.core.errors import FatalError
from kb.export.rows import check_rows, json_list, sorted_rows


def test_rows_come_sorted_out_of_all_files(tmp_path: Path, make_rows, fill) -> None:
    with pytest.raises(FatalError):
        check_rows(tmp_path, "youtube/videos")
    rows = make_rows("youtube/videos", 20)
    fill(tmp_path, "youtube/videos", rows, 3)
    check_rows(tmp_path, "youtube/videos")
    read = [row["video_id"] for row in sorted_rows(tmp_path, "youtube/videos", ["video_id"])]
    assert read == sorted(rows["video_id"].to_pylist())


@pytest.mark.parametrize("items", [[], ["é"], [1, {"a": None}]])
def test_a_json_list_appears_only_when_it_is_complete(tmp_path: Path, items: list[object]) -> None:
    path = tmp_path / "list.json"
    with json_list(path) as add:
        for item in items:
            add(item)
        assert not path.exists()
    assert json.loads(path.read_text(encoding="ascii")) == items
