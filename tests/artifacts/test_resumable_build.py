"""A stopped build goes on, measures stay, and restored tables are replaced in order."""

from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.artifacts.measures import FILE, read_measures, write_measure
from kb.artifacts.restore import RestoreFolder
from kb.artifacts.resumable_build import Part, PartedBuild, clear_finished, write_part
from kb.core.errors import FatalError
from kb.core.progress import Progress
from kb.store.tables.shard_writer import sorted_shards
from kb.verify.root import verify
from kb.youtube.restore import TABLES
from tests.filters.made import run_at

PARTS = [Part(name, (), 2) for name in "abc"]
made: list[str] = []


def make_part(folder: str, name: str) -> dict[str, int]:
    if made[-1:] == ["stop"]:
        raise KeyboardInterrupt
    made.append(name)
    write_part(folder, name, [], "pairs/pairs", {"name": name})
    return {"pairs": 1}


def build(root: Path, rule: int = 1) -> PartedBuild:
    parted = PartedBuild(run_at(root), "pairs", {"clean/youtube": "digest"}, {"rule": rule})
    parted.begin()
    return parted


def finish(parted: PartedBuild, *, complete: bool = True) -> None:
    with parted.finish(complete=complete) as fresh:
        sorted_shards(parted.rows, fresh.folder, "pairs/pairs", released=False)
        fresh.figures = {"parts": [one["name"] for one in parted.figures()]}


@pytest.fixture(autouse=True)
def nothing_made() -> None:
    made.clear()


def test_a_stopped_build_goes_on_and_leaves_no_part(tmp_path: Path) -> None:
    build(tmp_path).make(PARTS[:2], make_part, "rows", [])
    made.append("stop")
    with pytest.raises(KeyboardInterrupt):
        build(tmp_path).make(PARTS, make_part, "rows", [])
    made.clear()
    parted = build(tmp_path)
    parted.make(PARTS, make_part, "rows", [])
    assert made == ["c"]
    assert not parted.is_current()
    finish(parted)
    known = manifest.read(tmp_path, "pairs")
    assert known is not None
    assert known.figures["parts"] == ["a", "b", "c"]
    assert parted.is_current()
    assert not list((tmp_path / "state/pairs").iterdir())


def test_other_rules_start_anew_and_an_incomplete_build_keeps_its_parts(tmp_path: Path) -> None:
    parted = build(tmp_path)
    parted.make(PARTS[:1], make_part, "rows", [])
    finish(parted, complete=False)
    assert not parted.is_current()
    clear_finished(tmp_path, "pairs")
    assert len(parted.rows) == 1
    other = build(tmp_path, rule=2)
    other.make(PARTS, make_part, "rows", [])
    assert made == ["a", "a", "b", "c"]
    assert not parted.folder.exists()
    finish(other)
    write_part(str(other.folder), "a", [], "pairs/pairs", {})  # killed before they were removed
    clear_finished(tmp_path, "pairs")
    assert not other.folder.exists()


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
