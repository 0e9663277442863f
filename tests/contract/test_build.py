"""`kb build`: what is out of date is made, in order; nothing stale is released."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.youtube.job import Job

STEPS = (
    *("youtube export", "youtube export --format text", "youtube export --format minedojo"),
    *("reddit export", "reddit export --format convokit", "reddit export --format minedojo"),
    *("pairs", "pairs --format video2dataset", "pairs --format minedojo"),
    *("tasks", "tasks --format minedojo", "links", "index", "report", "search hello"),
    *("label export pairs --out pairs", "label export tasks --out tasks", "pairs measure --plan"),
)


@pytest.fixture(scope="module")
def crawled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """Raw answers of two sources, which tests copy."""
    world = World(n_channels=6, n_videos=40, n_posts=16, width=12, depth=4)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"))
        job.done("youtube", "crawl")
        job.done("reddit", "crawl")
        yield job


@pytest.fixture
def job(crawled: Job, tmp_path: Path) -> Job:
    """A root of its own with these answers."""
    shutil.copytree(crawled.root, tmp_path / "data", symlinks=True)
    return Job(crawled.sandbox, tmp_path)


def test_empty_is_a_size(job: Job) -> None:
    """Where nothing passed the filter, every later step makes nothing of it, and ends well."""
    job.profile(
        ("min_views = 100", "min_views = 500_000_000"), ("min_score = 5", "min_score = 500_000")
    )
    for source in ("youtube", "reddit"):
        assert job.done(source, "filter", code=1)["kept"] == 0
    for step in STEPS:
        done = job.kb(*step.split())
        assert done.returncode == 0, f"kb {step}: {done.stderr}"
    job.done("verify")  # exit 0: an empty list is whole
