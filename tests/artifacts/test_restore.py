"""Tests of `kb.artifacts.restore`."""

from pathlib import Path

import pytest

from kb.artifacts.restore import RestoreFolder
from kb.youtube.restore import TABLES


def test_the_table_that_decides_what_is_asked_for_is_replaced_last(tmp_path: Path) -> None:
    folder = RestoreFolder(tmp_path / "out", TABLES, "video_id", "shared/missing", 10)

    def merge(name: str, **finish: object) -> None:
        scratch = tmp_path / name
        scratch.mkdir()
        folder.merge(scratch, 1, {}, **finish)

    def obstruct(rows):
        (folder.path / ".transcripts.old" / "in-the-way").mkdir(parents=True)
        return rows

    merge("first")
    videos = (folder.path / "videos").stat().st_ino
    with pytest.raises(OSError, match="not empty"):
        merge("second", finish=obstruct)
    assert (folder.path / "videos").stat().st_ino == videos
