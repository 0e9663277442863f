"""Tests of `kb.verify.repair`."""

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import manifest
from kb.core.config.pipeline import Recipe
from kb.core.progress import Progress
from kb.store.tables.shard_writer import write_table
from kb.verify.repair import Crawl, Make, Step, repaired
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
    emptied(root / "raw/youtube/tombstones.parquet")
    said = repair(root)
    assert found(root) == []
    assert released.read_bytes() == whole
    commands = ("kb youtube filter", "kb pairs --again", "kb youtube export")
    assert all(any(f"`{command}` was run" in line for line in said) for command in commands)
    assert any("was restored from its copy" in line for line in said)


def test_a_release_without_its_description_gets_it_where_nothing_is_damaged(root: Path) -> None:
    """A repair that was killed before it came to the description; the lock's sweep takes the
    temporary files that told of it.
    """
    noted = root / "state/releases/youtube/1.0.0.parquet"
    noted.parent.mkdir(parents=True)
    pq.write_table(pa.table({"table": ["videos"], "key": [b"1"]}), noted)
    assert verify(root).entries == []
    said = Recipe("verify").defined("repair")(run_at(root))[1]
    assert ["kb release" in line for line in said] == [True]


def test_a_repair_killed_after_its_crawl_filters_when_it_is_run_again(root: Path) -> None:
    raw = one(root, "raw/youtube/videos/*.zst")
    whole = raw.read_bytes()
    raw.unlink()
    runs: list[str] = []

    def killed_filter() -> None:
        raise KeyboardInterrupt

    def steps(clean: Callable[[], object]) -> list[Step]:
        crawl = Crawl("youtube", list, lambda: raw.write_bytes(whole))
        folder = (root / "clean/youtube",)
        return [crawl, Make("clean", "kb youtube filter", clean, folder, after="youtube")]

    with pytest.raises(KeyboardInterrupt):
        repaired(root, Progress(), steps(killed_filter))
    for expected in (1, 1):  # the second one finds nothing to do
        repaired(root, Progress(), steps(lambda: runs.append("filter")))
        assert len(runs) == expected
    assert found(root) == []


def test_repair_leaves_a_folder_with_somebody_elses_file(root: Path) -> None:
    mine = root / "clean/youtube/videos/mine.parquet"
    mine.write_text("x")
    gone = one(root, "clean/youtube/videos/part-*.parquet")
    gone.unlink()
    said = repair(root)
    assert any(f"move {mine} away, then run `kb youtube filter`" in line for line in said)
    assert mine.read_text() == "x"
    mine.unlink()
    repair(root)
    assert found(root) == []


def test_repair_says_which_command_asks_where_no_key_is_there(root: Path) -> None:
    path = one(root, "raw/youtube/videos/*.zst")
    flipped(path)
    said = repair(root)
    assert any("was set aside" in line or "set aside as" in line for line in said)
    assert any("`kb youtube crawl` failed" in line for line in said)
    assert any(f"{path.name}.damaged-" in name.name for name in path.parent.iterdir())
    (path.parent / "notes.txt").write_text("x")
    told = {(each.state, each.path.name): each.advice for each in verify(root).entries}
    assert told.keys() == {("missing", "youtube"), ("foreign", "notes.txt")}
    assert "kb youtube crawl" in told["missing", "youtube"]


def test_a_damaged_state_is_set_aside(root: Path) -> None:
    path = root / "state/youtube.sqlite"
    path.write_bytes(b"nothing" * 1000)
    assert any("is built again from the raw data" in line for line in repair(root))
    assert (root / "state/youtube.sqlite.damaged").read_bytes() == b"nothing" * 1000
    assert all(kind == "raw answers" for kind, *_ in found(root)) or found(root) == []


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
    repair(root)
    assert found(root) == []
