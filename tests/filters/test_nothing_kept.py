"""`kb <source> filter` that keeps nothing."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.server import Sandbox
from kb.sandbox.world import World
from tests.youtube.job import Job


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Job]:
    """A crawl of a small world."""
    with Sandbox(World(n_channels=2, n_videos=6), services=["youtube"]) as sandbox:
        yield Job(sandbox, tmp_path)


def test_where_all_rows_are_rejected_the_most_frequent_reason_is_named(job: Job) -> None:
    job.done("youtube", "crawl")
    job.profile(("min_views = 100\n", "min_views = 1000000000\n"))
    summary = job.done("youtube", "filter", code=1)
    assert (summary["kept"], summary["pending"]) == (0, 0)
    assert "nothing was kept" in summary["error"]
    assert "views: below" in summary["error"]
    line = job.stopped("youtube", "filter", code=1)
    assert job.env["KB_PROFILE"] in line
    assert job.rows("SELECT count(*) AS n FROM clean.youtube_rejected")[0]["n"] > 0
