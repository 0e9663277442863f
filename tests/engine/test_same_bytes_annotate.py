"""Scores of a two-worker cluster are the bytes of the local engine,
also when a worker is killed.
"""

from pathlib import Path

import pytest

from kb.annotate import toxicity
from kb.annotate.toxicity import ToxicityScorer
from kb.core import clock
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.sandbox.toxicity import tiny_checkpoint
from tests.annotate.demo_texts import WORDS
from tests.conftest import needs

needs("distributed", "torch", "detoxify")


pytestmark = pytest.mark.dask


@pytest.fixture(scope="module")
def texts():
    rng = clock.rng("texts of the engine test")
    said = [*WORDS["plain"], *WORDS["harmless"], *WORDS["kinds"]["insult"]]
    return [" ".join(rng.choices(said, k=rng.randint(1, 40))) for _ in range(600)]


def score(root: Path, texts: list[str], **options) -> bytes:
    settings = load_settings(dotenv=False, kb_toxicity_model=str(tiny_checkpoint()))
    run = Run(settings=settings, profile=load_profile("minecraft"), root=root, **options)
    counts = ToxicityScorer.open(run, "reddit").annotate([texts])
    assert counts.scored == len(set(texts))
    [file] = (root / "annotations/reddit").glob("*.parquet")
    return file.read_bytes()


def test_both_engines_and_any_number_of_workers_write_the_same_scores(
    cluster, kill_a_worker, texts, tmp_path, monkeypatch
):
    monkeypatch.setattr(toxicity, "CHUNK_TEXTS", 40)
    expected = score(tmp_path / "one", texts, workers=1)
    assert score(tmp_path / "two", texts, workers=2) == expected
    on_dask = {"workers": 2, "engine": "dask", "scheduler": cluster.scheduler_address}
    assert score(tmp_path / "dask", texts, **on_dask) == expected
    folder = tmp_path / "killed/annotations/reddit"
    killed = kill_a_worker(lambda: any(folder.glob("part-*.parquet")))
    assert score(tmp_path / "killed", texts, **on_dask) == expected
    assert killed
