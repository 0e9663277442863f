"""Filter and scores of wiki pages: the same bytes by one worker, two, a cluster,
and one whose worker dies.
"""

import shutil

import pytest

from kb.annotate.toxicity import ToxicityScorer
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.filters.filter_run import run_clean, texts
from kb.sandbox.toxicity import tiny_checkpoint
from kb.store.tables import partition
from tests.conftest import needs
from tests.engine.test_same_bytes_youtube import digests
from tests.wiki.handmade_data import MONDAY, many, page, put, refused, told

needs("distributed", "torch", "detoxify")


pytestmark = pytest.mark.dask

PAGES = 150


@pytest.fixture(scope="module")
def crawled(tmp_path_factory):
    root = tmp_path_factory.mktemp("crawled")
    many(root, PAGES)
    put(
        root,
        "pages",
        (MONDAY, told(page(1, "Broken"), {"ns": 0, "title": "Nowhere", "missing": True})),
    )
    put(root, "renders", (MONDAY, refused(1, "Broken", "failed", "too_tall")))
    return root


@pytest.fixture
def start(crawled, tmp_path, monkeypatch):
    """start(name, options of the run) → a Run on a copy of the crawl,
    cut into as many tasks as a large one.
    """
    monkeypatch.setattr(partition, "RAW_BYTES", 300_000)
    settings = load_settings(dotenv=False, kb_toxicity_model=str(tiny_checkpoint()))

    def start(name: str, **options) -> Run:
        shutil.copytree(crawled / "raw", tmp_path / name / "raw")
        return Run(
            settings=settings, profile=load_profile("minecraft"), root=tmp_path / name, **options
        )

    return start


@pytest.fixture
def on_dask(cluster):
    return {"workers": 2, "engine": "dask", "scheduler": cluster.scheduler_address}


def clean(run: Run) -> dict[str, str]:
    summary = run_clean(run, "wiki")
    assert summary["kept"] + summary["stages"].get("toxicity", 0) == PAGES
    assert summary["rejected"] == summary["crawled"] - summary["kept"]
    return digests(run.root, "clean", "annotations")


def annotate(run: Run) -> dict[str, str]:
    """What `kb annotate wiki` does."""
    assert ToxicityScorer.open(run, "wiki").annotate(texts(run, "wiki")).scored == PAGES
    return digests(run.root, "annotations")


def test_every_engine_filters_to_the_same_bytes(start, on_dask, kill_a_worker):
    expected = clean(start("one", workers=1))
    assert len([path for path in expected if "/pages/" in path]) > 16
    assert clean(start("two", workers=2)) == expected
    assert clean(start("dask", **on_dask)) == expected
    run = start("killed", **on_dask)
    killed = kill_a_worker(lambda: any((run.root / "clean/.wiki.new").rglob("*.parquet")))
    assert clean(run) == expected
    assert killed


def test_every_engine_scores_to_the_same_bytes(start, on_dask, kill_a_worker):
    expected = annotate(start("one", workers=1))
    assert annotate(start("dask", **on_dask)) == expected
    run = start("killed", **on_dask)
    killed = kill_a_worker(lambda: any((run.root / "clean/.wiki.work").rglob("texts-*.arrow")))
    assert annotate(run) == expected
    assert killed
    assert not list((run.root / "clean").iterdir())
