"""Small worlds for single questions; one whole job, done once, for what a finished data
root shows.
"""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.conftest import skip_or_fail
from tests.faults import Sandbox
from tests.youtube.job import Job


@pytest.fixture
def small() -> Iterator[Sandbox]:
    """Nine channels, sixty videos, every case once."""
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        yield sandbox


@pytest.fixture
def few() -> Iterator[Sandbox]:
    """Nine channels and thirty videos, for what is asked many times."""
    with Sandbox(World(n_channels=9, n_videos=30), services=["youtube"]) as sandbox:
        yield sandbox


@pytest.fixture
def job(few: Sandbox, tmp_path: Path) -> Job:
    """A fresh data root on the world of few videos."""
    return Job(few, tmp_path)


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """The whole world crawled, scored, filtered and exported; read only."""
    if (
        importlib.util.find_spec("torch") is None
        or importlib.util.find_spec("transformers") is None
    ):
        skip_or_fail("the extra `toxicity` is not installed")
    with Sandbox(World(), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("whole"), toxicity=True)
        job.crawl_summary = job.done("youtube", "crawl")
        job.filter_summary = job.done("youtube", "filter")
        job.export_summary = job.done("youtube", "export")
        yield job
