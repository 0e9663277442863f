"""`kb status` reads the state of all sources, also beside a running crawl."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.store.lock import writer
from kb.store.state.frontier import Frontier


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "data"


def fill(root: Path) -> None:
    frontier = Frontier(root / "state" / "youtube.sqlite")
    frontier.add("metadata", ["a", "b", "c", "d"])
    frontier.take("metadata", 3)
    frontier.done("metadata", "a")
    frontier.error("metadata", "b", "http 500")
    frontier.add("transcripts", ["a"])
    frontier.spend("general", 1, "videos.list", day="2026-11-20")
    frontier.spend("general", 1, "videos.list", day="2026-11-20")
    frontier.spend("search", 1, "search.list", day="2026-11-19")
    frontier.close()
    videos = root / "clean" / "youtube" / "videos"
    videos.mkdir(parents=True)
    days = [datetime(2026, 11, 20, tzinfo=UTC), datetime(2026, 10, 1, tzinfo=UTC)]
    pq.write_table(
        pa.table({"video_id": ["a", "b"], "fetched_at": pa.array(days, pa.timestamp("us", "UTC"))}),
        videos / "part-0.parquet",
    )


def status(kb: Any, *options: str) -> dict[str, Any]:
    # 20:00 UTC is noon in California, where the quota's day is counted.
    answer = kb("status", "--json", *options, env={"KB_NOW": "2026-11-20T20:00:00Z"})
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout.splitlines()[-1])


def test_an_empty_root_says_where_to_start_and_writes_nothing(kb: Any, tmp_path: Path) -> None:
    answer = kb("status")
    assert answer.returncode == 0
    assert "nothing collected yet" in answer.stdout
    assert "kb demo" in answer.stdout
    assert list(tmp_path.iterdir()) == []


def test_progress_quota_age_and_disk(kb: Any, root: Path) -> None:
    fill(root)
    about = status(kb)
    source = about["sources"]["youtube"]
    assert source["phases"]["metadata"] == {
        "done": 1,
        "error": 1,
        "in_progress": 1,
        "todo": 1,
        "total": 4,
        "left": 2,
    }
    assert source["phases"]["transcripts"]["left"] == 1
    assert (source["left"], about["left"]) == (3, 3), "what failed is counted by itself"
    assert (source["requests"], source["units"]) == (3, 3)
    assert source["quota"]["general"] == {
        "spent": 2,
        "left": 9998,
        "limit": 10000,
        "resets_at": "2026-11-21T08:00:00Z",
    }
    assert source["quota"]["search"]["spent"] == 0
    assert source["rows"] == {"videos": 2}
    assert (source["oldest"], source["newest"]) == ("2026-10-01T00:00:00Z", "2026-11-20T00:00:00Z")
    assert (source["too_old"], source["max_age_days"]) == (1, 30)
    assert about["disk_bytes"]["clean"] > 0
    assert about["disk_bytes_total"] == sum(about["disk_bytes"].values())


def test_for_people(kb: Any, root: Path) -> None:
    fill(root)
    answer = kb("status", env={"KB_NOW": "2026-11-20T20:00:00Z"})
    assert "metadata" in answer.stdout
    assert (
        "quota general: 2 of 10,000 spent today, 9,998 left, resets 2026-11-21T08:00:00Z"
        in answer.stdout
    )
    assert "1 rows older than 30 days" in answer.stdout


def test_beside_a_running_crawl(kb: Any, root: Path) -> None:
    """The crawl holds the lock and an open transaction; status neither waits nor disturbs."""
    import os

    fill(root)
    with writer(root, "youtube"):
        frontier = Frontier(root / "state" / "youtube.sqlite")
        with frontier.transaction():
            frontier.add("metadata", ["e"])
            source = status(kb)["sources"]["youtube"]
            assert source["running_pid"] == os.getpid()
            assert source["phases"]["metadata"]["total"] == 4
        frontier.close()
    assert status(kb)["sources"]["youtube"]["running_pid"] is None


def test_any_name_of_the_data_root(kb: Any, tmp_path: Path) -> None:
    """What is a pattern, a query or an escape elsewhere is a letter of a folder's name here."""
    root = tmp_path / "a#b?c%41[d]*'e{f,g}"
    fill(root)
    source = status(kb, "--data", str(root))["sources"]["youtube"]
    assert source["phases"]["metadata"]["total"] == 4
    assert (source["rows"], source["too_old"]) == ({"videos": 2}, 1)
    assert list(tmp_path.iterdir()) == [root]


def test_damaged_rows_are_named(kb: Any, root: Path) -> None:
    fill(root)
    file = root / "clean" / "youtube" / "videos" / "part-0.parquet"
    file.write_bytes(file.read_bytes()[:100])
    answer = kb("status")
    assert answer.returncode == 1
    assert f"{file} can't be read" in answer.stderr
    assert "run `kb youtube filter` again" in answer.stderr
    assert answer.stderr.count("\n") == 1


def test_damaged_state_is_one_line(kb: Any, root: Path) -> None:
    (root / "state").mkdir(parents=True)
    (root / "state" / "reddit.sqlite").write_bytes(
        b"this is no database, whatever its name says" * 100
    )
    answer = kb("status")
    assert answer.returncode == 1
    assert "reddit.sqlite" in answer.stderr
    assert answer.stderr.count("\n") == 1
