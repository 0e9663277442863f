"""`kb update`: what was deleted at a service is gone here within one run; quotas are respected."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.youtube.job import Job

LATER = "2027-01-10T12:00:00Z"


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Job]:
    world = World(n_channels=6, n_videos=40, n_posts=16, width=12, depth=4)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        yield Job(sandbox, tmp_path)


def test_what_is_gone_there_is_gone_here_and_nothing_is_asked_twice(job: Job) -> None:
    job.done("youtube", "crawl")
    job.done("youtube", "filter")
    (gone, *_) = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    job.sandbox.world.youtube.videos[gone["video_id"]].in_api = False
    plan = job.done("update", "--plan", KB_NOW=LATER)
    assert plan["requests"] > 0
    assert {one["artifact"] for one in plan["steps"]} >= {"pairs", "release"}
    done = job.done("update", KB_NOW=LATER)
    assert list(done["sources"]) == ["youtube"]
    assert done["sources"]["youtube"]["purge youtube"]["purged"] >= 1
    assert (
        job.rows(f"SELECT * FROM clean.youtube_videos WHERE video_id = '{gone['video_id']}'") == []
    )
    before = len(job.sandbox.ledger)
    again = job.done("update", KB_NOW=LATER)
    made = [one["artifact"] for one in again["steps"] if one["outcome"] == "made"]
    assert made == ["clean/youtube"]  # the lists were read again, and give the same rows
    asked = [one.path for one in job.sandbox.ledger.requests(since=before)]
    assert not [path for path in asked if path.endswith(("/videos", "/timedtext"))]


def test_only_what_was_crawled_takes_part(job: Job) -> None:
    assert job.kb("update").returncode == 2  # no data root
    job.done("reddit", "crawl", "--limit", "3", code=3)
    refused = job.kb("update", "youtube")
    assert refused.returncode == 1
    assert "kb youtube crawl" in refused.stderr
    assert job.kb("update", "nothing").returncode == 2
    lacking = job.kb("update", REDDIT_CLIENT_ID="")
    assert lacking.returncode == 2
