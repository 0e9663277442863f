"""Tests of `kb verify --repair`."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from kb.artifacts import freshness, manifest
from kb.artifacts.makers import make_artifact, make_outdated
from kb.core.config.pipeline import Recipe
from kb.core.errors import DamagedData
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.state.frontier import Frontier
from kb.store.tables.shard_writer import write_table
from tests.filters.made import run_at
from tests.verify.conftest import emptied
from tests.verify.test_root import flipped, found, one, verify


def repair(root: Path) -> list[str]:
    said: list[str] = Recipe("verify").defined("repair")(run_at(root))[1]
    return said


def test_repair_makes_again_what_raw_data_can_make(root: Path) -> None:
    released = one(root, "release/youtube/videos-*.parquet")
    whole = released.read_bytes()
    flipped(released)
    one(root, "clean/youtube/videos/*.parquet").unlink()
    flipped(one(root, "pairs/pairs-*.parquet"))
    said = repair(root)
    assert found(root) == []
    assert released.read_bytes() == whole
    for name in ("clean/youtube", "pairs", "release/youtube"):
        assert f"{name} was made again" in said
    assert repair(root) == []


def test_a_build_makes_again_what_a_reader_found_damaged(root: Path) -> None:
    run, path = run_at(root), one(root, "pairs/pairs-*.parquet")
    whole = path.read_bytes()
    path.write_bytes(whole + b"x")
    assert f"{path.name} is damaged" in freshness.reasons(run, "pairs")
    path.write_bytes(whole)
    stale = freshness.reasons(run, "pairs")
    assert f"{path.name} is damaged" not in stale
    path.write_bytes(bytes(len(whole)))  # of the same size: only a reader sees it
    assert freshness.reasons(run, "pairs") == stale
    with pytest.raises(DamagedData, match=path.name):
        make_artifact(run, "release/pairs")
    assert f"{path.name} is damaged" in freshness.reasons(run, "pairs")
    assert [outcome.outcome for outcome in make_outdated(run, {"pairs": []})] == ["made"]
    assert path.read_bytes() == whole
    assert freshness.reasons(run, "pairs") == []


def test_lost_answers_are_left_to_a_crawl_and_nothing_is_sent(root: Path) -> None:
    path = one(root, "raw/youtube/videos/*.zst")
    with closing(Frontier(Layout(root).state("youtube"))) as frontier:
        frontier.spend("general", 5, "videos.list")
    answers = sum(1 for _ in rawlog.Frames(path))
    flipped(path)
    said = repair(root)
    (aside,) = path.parent.glob(f"{path.name}.damaged-*")
    assert sum(1 for _ in rawlog.Frames(path)) == answers - 1 if path.exists() else answers == 1
    assert any(aside.name in line and "kb youtube crawl" in line for line in said)
    assert any(line.startswith("a release is refused: clean/youtube") for line in said)
    (path.parent / "notes.txt").write_text("x")
    told = {(each.state, each.path.name): each.advice for each in verify(root).entries}
    assert told.keys() == {("missing", "youtube"), ("foreign", "notes.txt")}
    assert "kb youtube crawl" in told["missing", "youtube"]
    with closing(Frontier(Layout(root).state("youtube"))) as frontier:
        assert frontier.requests() == (1, 5)


def test_repair_leaves_a_folder_with_somebody_elses_file(root: Path) -> None:
    mine = root / "clean/youtube/videos/mine.parquet"
    mine.write_text("x")
    one(root, "clean/youtube/videos/part-*.parquet").unlink()
    assert f"clean/youtube was left: move {mine} away, then run `kb build`" in repair(root)
    assert mine.read_text() == "x"
    mine.unlink()
    repair(root)
    assert found(root) == []


def test_a_foreign_file_makes_no_repair_fail(root: Path, kb: Any) -> None:
    (root / "clean/youtube/videos/mine.parquet").write_text("x")
    for option, code in (("--quiet", 1), ("--repair", 0)):
        told = kb("verify", option, "--data", str(root))
        assert told.returncode == code, told.stderr
        assert f"foreign: {root}" in told.stdout


def test_a_damaged_state_is_set_aside_and_replayed(root: Path) -> None:
    path = root / "state/youtube.sqlite"
    path.write_bytes(b"nothing" * 1000)
    assert any("it is replayed from" in line for line in repair(root))
    assert (root / "state/youtube.sqlite.damaged").read_bytes() == b"nothing" * 1000
    assert found(root) == []


@pytest.mark.parametrize("harm", [Path.unlink, emptied])
def test_lost_scores_are_left_to_the_next_filter(
    root: Path, make_rows, harm: Callable[[Path], object]
) -> None:
    path = root / "annotations/youtube/toxicity.parquet"
    write_table(path, make_rows("shared/annotations", 3), "shared/annotations")
    manifest.record(path.parent, "annotations/youtube")
    assert found(root) == []
    harm(path)
    assert [kind for kind, _, _ in found(root)] == ["annotations"]
    assert any(f"{path} was set aside" in line for line in repair(root))
    assert found(root) == []
