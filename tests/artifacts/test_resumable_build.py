"""A stopped build goes on, other rules start anew, and no part is left in the end."""

from pathlib import Path

import pytest

from kb.artifacts import manifest
from kb.artifacts.resumable_build import Part, PartedBuild, clear_finished, write_part
from kb.store.tables.shard_writer import sorted_shards
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
