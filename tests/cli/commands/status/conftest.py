"""A small data root, and what `kb status` says of it."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.store.state.frontier import Frontier


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "data"


def fill(root: Path) -> None:
    frontier = Frontier(root / "state" / "youtube.sqlite")
    frontier.add_keys("metadata", ["a", "b", "c", "d"])
    frontier.take("metadata", 3)
    frontier.done("metadata", "a")
    frontier.error("metadata", "b", "http 500")
    frontier.add_keys("transcripts", ["a"])
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
