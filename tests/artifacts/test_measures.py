"""Sections of measures stay beside each other, and restored tables are replaced in order."""

from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.artifacts.measures import FILE, read_measures, write_measure
from kb.artifacts.restore import RestoreFolder
from kb.core.errors import FatalError
from kb.core.progress import Progress
from kb.verify.root import verify
from kb.youtube.restore import TABLES


def test_sections_do_not_replace_each_other(tmp_path: Path) -> None:
    with pytest.raises(FatalError, match="there are no pairs"):
        write_measure(tmp_path, "one", {"n": 1})
    with manifest.replacing(tmp_path, "pairs", inputs={}):
        pass
    assert read_measures(tmp_path / "pairs") == {}
    write_measure(tmp_path, "two", {"n": 2})
    write_measure(tmp_path, "one", {"n": 1})
    write_measure(tmp_path, "two", {"n": 3})
    assert read_measures(tmp_path / "pairs") == {"one": {"n": 1}, "two": {"n": 3}}


def test_a_changed_byte_is_found(tmp_path: Path) -> None:
    with manifest.replacing(tmp_path, "pairs", inputs={}):
        pass
    path = write_measure(tmp_path, "one", {"n": 1})
    assert path == tmp_path / "pairs" / FILE
    assert not verify(tmp_path, Progress()).entries
    path.write_text(path.read_text().replace("1", "2"))
    assert [one.path for one in verify(tmp_path, Progress()).entries] == [path]


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
