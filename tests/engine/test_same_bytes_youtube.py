"""Filter, pairs and release of a crawl: the same bytes by one worker, two, a cluster,
and one whose worker dies.
"""

import hashlib
import shutil
from pathlib import Path

import pytest

from kb.core.config import pipeline
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.filters.filter_run import run_clean
from kb.pairs import build
from kb.sandbox.toxicity import tiny_checkpoint
from kb.sandbox.world import World
from kb.store.tables import partition
from tests.conftest import needs
from tests.faults import Sandbox
from tests.youtube.job import NOW, Job

needs("distributed", "torch", "detoxify")


pytestmark = pytest.mark.dask


@pytest.fixture(scope="module")
def crawled(tmp_path_factory):
    """Raw data of a small world, with the scores of its texts."""
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"), toxicity=True)
        job.done("youtube", "crawl")
    return job.root


@pytest.fixture(autouse=True)
def many_tasks(monkeypatch):
    """A small crawl cut into as many tasks as a large one."""
    monkeypatch.setenv("KB_NOW", NOW)
    monkeypatch.setattr(partition, "RAW_BYTES", 12_000)
    monkeypatch.setattr(build, "_ROWS", 6)


def copy(crawled: Path, root: Path, *more: Path) -> Path:
    """A data root with the crawl, and what else is to be there already."""
    for folder in (crawled / "raw", crawled / "state", *more):
        shutil.copytree(folder, root / folder.name)
    return root


def start(root: Path, **options) -> Run:
    settings = load_settings(dotenv=False, kb_toxicity_model=str(tiny_checkpoint()))
    return Run(settings=settings, profile=load_profile("minecraft"), root=root, **options)


def clean(run: Run) -> dict[str, str]:
    """Filter and export; sha256 by path of all that they made."""
    summary = run_clean(run, "youtube")
    assert summary["kept"] > 20
    assert summary["rejected"] > 20
    pipeline.load(str(pipeline.locate("youtube"))).export(run, "parquet")
    return digests(run.root, "clean/youtube", "annotations", "release/youtube")


def pairs(run: Run) -> dict[str, str]:
    """Pairs and their release; sha256 by path."""
    made = pipeline.load(str(pipeline.locate("pairs"))).pairs(run, "parquet")
    assert made["pairs"] > 100
    return digests(run.root, "pairs", "release/pairs")


def digests(root: Path, *tops: str) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for top in tops
        for path in sorted((root / top).rglob("*"))
        if path.is_file()
    }


def test_every_engine_writes_the_same_bytes(crawled, cluster, kill_a_worker, tmp_path):
    on_dask = {"workers": 2, "engine": "dask", "scheduler": cluster.scheduler_address}
    one = start(copy(crawled, tmp_path / "one"), workers=1)
    rows, index = clean(one), pairs(one)
    assert len(rows) > 8
    two = start(copy(crawled, tmp_path / "two", one.root / "annotations"), workers=2)
    assert clean(two) == rows

    # The cluster scores the texts itself, and one of its workers is killed while it sorts the rows.
    dask = start(copy(crawled, tmp_path / "dask"), **on_dask)
    killed = kill_a_worker(lambda: any((dask.root / "clean/.youtube.new").rglob("*.parquet")))
    assert clean(dask) == rows
    assert killed, "no worker was killed while filtering"

    again = start(copy(crawled, tmp_path / "again", one.root / "clean"), **on_dask)
    killed = kill_a_worker(lambda: any((again.root / "state/pairs").rglob("*.parquet")))
    assert pairs(again) == index
    assert killed, "no worker was killed while making pairs"
