"""`kb links`, `kb report`, `kb annotate` and `kb models` at the command line."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import kb
from kb.annotate.toxicity import ToxicityScorer
from kb.artifacts.makers import make_artifact
from kb.core.context import Run
from kb.filters.filter_run import run_clean, texts
from kb.release.metadata.measure import models
from kb.sandbox.world import World
from kb.store.tables.shard_writer import write_table
from tests.annotate.conftest import make_run, tiny  # noqa: F401  fixtures
from tests.annotate.made import make_checkpoint
from tests.conftest import needs
from tests.faults import Sandbox
from tests.inprocess import Here
from tests.links import made
from tests.links.conftest import run  # noqa: F401  a fixture
from tests.recipes import release
from tests.release.made import build
from tests.report.made import a_run
from tests.youtube.job import Job


def test_the_release_has_ids_and_counts(run: Run, here: Here) -> None:  # noqa: F811
    at = ("--data", str(run.root), "--profile", str(run.profile.path))
    done = here("links", "--json", *at)
    assert done.code == 0, done.err
    assert json.loads(done.out.splitlines()[-1])["release"] == str(run.root / "release" / "links")
    summary = release(run)
    assert summary["sources"] == {
        "links": {"entities": 9, "links": len(made.rows(run.root))},
    }
    folder = run.root / "release" / "links"
    held = pq.read_table(next(folder.glob("links-*.parquet")))
    assert held.to_pylist() == made.rows(run.root)
    texts = {path.name: path.read_text() for path in folder.iterdir() if path.suffix != ".parquet"}
    for said in ("near an oak", "the wolf and the dragon", "chest wolf"):
        assert not any(said in text for name, text in texts.items() if "sample" in name)
        assert not any(said.encode() in path.read_bytes() for path in folder.glob("*.parquet"))
    assert "What is named in most places" in texts["README.md"]
    data = kb.load(folder)
    assert {"entities", "links"} <= set(data.tables)
    assert data.sql("SELECT sum(count) AS n FROM links").to_pylist() == [
        {"n": sum(row["count"] for row in made.rows(run.root))}
    ]
    # What was filtered since is not to be published by what names it.
    made.fill(run.root, comments=["a wolf"], posts=[("Dragon", "", [])])
    done = here("release", *at)
    assert done.code == 1
    assert "out of date: links: clean/reddit\n" in done.err
    assert "run `kb build" in done.err
    assert here("links", *at).code == here("release", *at).code == 0
    held = pq.read_table(next(folder.glob("links-*.parquet")))
    # A text in a column is refused.
    rows = held.set_column(2, "key", pa.array(["a wolf and a bed"] * held.num_rows))
    write_table(next(folder.glob("links-*.parquet")), rows, "links/links", released=True)
    assert here("release", *at).code == 1


def test_pdfs_are_made_when_asked_for_and_repeated_by_a_build(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from kb.cli import main

    (tmp_path / "state").mkdir()
    build(tmp_path, sources=("pairs",), export=False, n=10)
    made = tmp_path / "report"
    for words, suffixes in (([], {".svg", ".png"}), (["--figures"], {".svg", ".png", ".pdf"})):
        with pytest.raises(SystemExit) as left:
            main(["report", *words, "--data", str(tmp_path), "--json", "--quiet"])
        assert not left.value.code
        assert json.loads(capsys.readouterr().out.splitlines()[-1])["figures"] == 3
        assert {path.suffix for path in made.iterdir()} == {".html", ".json", *suffixes}
    make_artifact(a_run(tmp_path), "report")
    assert {path.suffix for path in made.iterdir()} == {".html", ".json", *suffixes}


needs("torch", "detoxify")


@pytest.fixture(scope="module")
def crawled(tmp_path_factory):
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"), toxicity=True)
        job.done("youtube", "crawl")
        yield job


@pytest.fixture
def job(crawled, tmp_path):
    fresh = Job(crawled.sandbox, tmp_path, toxicity=True)
    for name in ("raw", "state"):
        shutil.copytree(crawled.root / name, fresh.root / name)
    return fresh


def test_annotate_stops_at_the_limit_goes_on_and_then_has_nothing_to_do(job):
    first = job.done("annotate", "youtube", "--limit", "10", code=3)
    assert first["precisions"] == {"fp32": 10}
    second = job.done("annotate", "youtube")
    assert second["known"] == 10
    assert second["scored"] > 20
    third = job.done("annotate", "youtube", "--precision", "int8")
    assert (third["scored"], third["known"]) == (0, first["precisions"]["fp32"] + second["scored"])
    assert third["model"] == "lorecrawl_tiny"
    # The filter finds every score there is, and rejects by them.
    assert job.done("youtube", "filter")["stages"]["toxicity"] > 0
    unscored = (
        "SELECT count(*) n FROM clean.youtube_videos WHERE title <> '' AND toxicity_title IS NULL"
    )
    assert job.rows(unscored) == [{"n": 0}]


def test_without_a_model_nothing_is_written_and_the_line_names_the_command(job, tmp_path):
    missing = {"KB_TOXICITY_MODEL": "original", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    for words in (("youtube", "filter"), ("annotate", "youtube")):
        assert "kb models fetch" in job.stopped(*words, code=2, **missing)
    assert not (job.root / "clean").exists()
    assert not (job.root / "annotations").exists()


def test_a_damaged_model_is_exit_2(job, tmp_path, tiny):  # noqa: F811
    shutil.copytree(tiny.parent, tmp_path / "model")
    path = tmp_path / "model" / tiny.name
    path.write_bytes(path.read_bytes()[:-100])
    said = job.stopped("annotate", "youtube", code=2, KB_TOXICITY_MODEL=str(path))
    assert "checksum mismatch" in said


def test_a_release_names_the_model_whose_scores_decided(job, make_run, tmp_path):  # noqa: F811
    """Scores of an earlier model stay beside the rows;
    they are no part of what was made with a later one.
    """
    first = make_run(root=job.root)
    with_tiny = run_clean(first, "youtube")
    assert models(job.root, "youtube") == ((with_tiny["model"], with_tiny["revision"], "fp32"),)
    assert with_tiny["model"] == "lorecrawl_tiny"
    second = make_run(root=job.root, model=str(make_checkpoint(tmp_path / "model")))
    ToxicityScorer.open(second, "youtube", precision="bf16").annotate(texts(second, "youtube"))
    other = run_clean(second, "youtube")
    assert other["model"] == "mine"
    found = models(job.root, "youtube")
    assert {(model, revision) for model, revision, _ in found} == {("mine", other["revision"])}
    assert "bf16" in {precision for _, _, precision in found}
    assert models(job.root, "pairs") == found
    run_clean(first, "youtube")
    assert models(job.root, "youtube") == ((with_tiny["model"], with_tiny["revision"], "fp32"),), (
        "nothing was scored anew"
    )


def test_options_that_can_not_work_are_exit_2(job):
    assert "tcp://" in job.stopped(
        "annotate", "youtube", "--engine", "dask", "--scheduler", "nowhere", code=2
    )
    assert "original" in job.stopped("models", "fetch", "nonesuch", code=2)
    assert job.kb("annotate", "youtube", "--precision", "fp8").returncode == 2


def test_fetch_refuses_another_file(job, tmp_path):
    """The sandbox's web site answers for the hub, and knows no such file."""
    cache = tmp_path / "cache"
    there = {"KB_MODELS_ENDPOINT": job.env["KB_YOUTUBE_WEB"], "XDG_CACHE_HOME": str(cache)}
    line = job.stopped("models", "fetch", code=1, **there)
    assert "config.json" in line
    assert not [path for path in cache.rglob("*") if path.is_file()]
