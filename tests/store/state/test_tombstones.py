"""What was purged stays away, whatever is copied over its tombstones."""

import shutil
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.core.errors import DamagedData
from kb.sandbox.world import World
from kb.store.layout import Layout
from kb.store.state import tombstones
from tests.faults import Sandbox
from tests.youtube.job import Job


def copy_raw(other: Path, root: Path) -> None:
    """`cp -r other/raw/. root/raw/`"""
    shutil.copytree(other / "raw", root / "raw", dirs_exist_ok=True)


def reasons(root: Path) -> dict[str, str]:
    return {row["key"]: row["reason"] for row in tombstones.read(root, "youtube").to_pylist()}


@pytest.fixture
def two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Two machines that purged different keys, and one key both, the second machine earlier."""
    mine, other = tmp_path / "mine", tmp_path / "other"
    monkeypatch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
    tombstones.add(mine, "youtube", [("a", "named"), ("both", "vanished")])
    monkeypatch.setenv("KB_NOW", "2026-11-19T12:00:00Z")
    tombstones.add(other, "youtube", [("b", "vanished"), ("both", "named")])
    return mine, other


def test_a_copied_raw_folder_adds_its_tombstones_and_takes_none(two: tuple[Path, Path]) -> None:
    mine, other = two
    copy_raw(other, mine)
    assert tombstones.keys(mine, "youtube") == {"a", "b", "both"}
    assert reasons(mine) == {"a": "named", "b": "vanished", "both": "named"}  # the older row of two


def test_a_writer_makes_the_file_in_raw_whole_again(two: tuple[Path, Path]) -> None:
    mine, other = two
    before = tombstones.version(mine, "youtube")
    copy_raw(other, mine)
    assert tombstones.version(mine, "youtube") != before
    tombstones.heal(mine, "youtube")
    file = tombstones.path(mine, "youtube")
    assert pq.read_table(file)["key"].to_pylist() == ["a", "b", "both"]
    whole, at = file.read_bytes(), file.stat().st_mtime_ns
    tombstones.heal(mine, "youtube")
    assert (file.read_bytes(), file.stat().st_mtime_ns) == (whole, at)
    # The same from either side, in raw alone (a folder that was copied without its state), or with
    # copies beside it.
    file.rename(file.with_name("tombstones-mine.parquet"))
    shutil.rmtree(mine / "state")
    assert tombstones.keys(mine, "youtube") == {"a", "b", "both"}
    tombstones.heal(mine, "youtube")
    assert [path.name for path in file.parent.iterdir()] == ["tombstones.parquet"]
    assert file.read_bytes() == whole


def test_a_tombstone_is_added_and_lifted_everywhere(two: tuple[Path, Path]) -> None:
    mine, other = two
    copy_raw(other, mine)
    assert tombstones.add(mine, "youtube", [("a", "vanished"), ("c", "named")]) == 1
    assert tombstones.lift(mine, "youtube", {"a", "b"}, ("vanished",)) == 1
    assert reasons(mine) == {"a": "named", "both": "named", "c": "named"}
    tombstones.path(mine, "youtube").unlink()
    assert reasons(mine) == {"a": "named", "both": "named", "c": "named"}


def test_nothing_is_written_where_nothing_was_purged(tmp_path: Path) -> None:
    tombstones.heal(tmp_path, "youtube")
    assert tombstones.keys(tmp_path, "youtube") == set()
    assert tombstones.read(tmp_path, "youtube").num_rows == 0
    assert list(tmp_path.iterdir()) == []


def test_a_purged_video_is_in_no_table_after_another_machine_s_raw_folder_was_copied_here(
    tmp_path: Path,
) -> None:
    with Sandbox(World(n_channels=9, n_videos=30), services=["youtube"]) as services:
        job, other = Job(services, tmp_path), tmp_path / "other"
        mine, theirs, *rest = services.world.youtube.videos
        job.done("youtube", "crawl", "--only", "metadata", "--ids", ids(job, [mine, theirs, *rest]))
        shutil.copytree(job.root / "raw", other / "raw")
        tombstones.add(other, "youtube", [(theirs, "named")])
        job.done("purge", "youtube", "--ids", ids(job, [mine]))
        copy_raw(other, job.root)
        job.done("youtube", "filter")
    known = {
        row["key"]
        for name in ("rejected", "pending")
        for row in job.rows(f"SELECT key FROM clean.youtube_{name}")
    }
    known |= {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_videos")}
    assert len(known) > 20
    assert not known & {mine, theirs}
    assert {mine, theirs} <= {
        row["key"] for row in job.rows("SELECT key FROM clean.youtube_tombstones")
    }


def ids(job: Job, keys: Iterable[str]) -> str:
    path = job.place / "ids.txt"
    path.write_text("".join(f"{key}\n" for key in keys))
    return str(path)


@pytest.mark.parametrize("how", ["empty", "cut", "binary", "another table", "a folder"])
def test_a_damaged_file_is_no_empty_one(tmp_path: Path, how: str) -> None:
    """What was purged would come back."""
    tombstones.add(tmp_path, "youtube", [("v1", "purged"), ("v2", "gone")])
    first, copy = Layout(tmp_path).tombstones("youtube")
    data = first.read_bytes()
    another = pa.BufferOutputStream()
    pq.write_table(pa.table({"key": [1]}), another)
    damaged = {
        "empty": b"",
        "cut": data[:-9],
        "binary": b"PAR1" * 40,
        "another table": another.getvalue().to_pybytes(),
    }

    def spoil(path: Path) -> None:
        path.unlink()
        if how == "a folder":
            path.mkdir()
        else:
            path.write_bytes(damaged[how])

    spoil(first)
    for use in (
        lambda: tombstones.keys(tmp_path, "youtube"),
        lambda: tombstones.read(tmp_path, "youtube"),
        lambda: tombstones.add(tmp_path, "youtube", [("v3", "purged")]),
        lambda: tombstones.heal(tmp_path, "youtube"),
    ):
        with pytest.raises(DamagedData, match=f"{first} can't be read") as error:
            use()
        assert error.value.hint == f"remove it: {copy} contains the purged keys as well"
    spoil(copy)
    with pytest.raises(DamagedData, match="can't be read") as error:
        tombstones.keys(tmp_path, "youtube")
    assert error.value.hint.startswith("restore it from a copy")
