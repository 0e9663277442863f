"""Filter, export, pairs and release of one crawl: the same bytes wherever and however they run."""

import shutil

import pytest

from kb.sandbox.world import World
from tests.annotate.least import LIMITS
from tests.conftest import needs
from tests.faults import Sandbox
from tests.youtube.job import Job

needs("torch", "detoxify")


pytestmark = pytest.mark.dask

# Half an hour beyond a whole zone; a locale whose comma and dotless i trip what asks for one.
ELSEWHERE = {"TZ": "Asia/Kolkata", "LC_ALL": "tr_TR.UTF-8", "PYTHONHASHSEED": "77", **LIMITS}
MADE = ("clean", "annotations", "pairs", "links", "release")


@pytest.fixture(scope="module")
def crawled(tmp_path_factory):
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"), toxicity=True)
        job.done("youtube", "crawl")
        yield job


def made(crawled: Job, place, workers: str, **env: str) -> dict[str, str]:
    job = Job(crawled.sandbox, place, toxicity=True, fresh=bool(env), **env)
    for name in ("raw", "state"):
        shutil.copytree(crawled.root / name, job.root / name)
    job.done("youtube", "filter", "--workers", workers)
    job.done("youtube", "export")
    job.done("pairs", "--workers", workers)
    job.done("links", "--workers", workers)
    job.done("release")
    return {f"{top}/{name}": at for top in MADE for name, at in job.digests(top).items()}


def test_another_processor_locale_time_zone_hash_seed_and_number_of_workers(crawled, tmp_path):
    here = made(crawled, tmp_path / "here", "1")
    assert any(name.startswith("release/pairs") for name in here), sorted(here)
    assert any(name.startswith("annotations") for name in here)
    assert made(crawled, tmp_path / "elsewhere", "2", **ELSEWHERE) == here
