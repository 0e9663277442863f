"""Roots with every kind of file are merged, and every command works on the result."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from kb.artifacts import manifest
from kb.artifacts.score_files import KEY
from kb.labels.imports import stored
from kb.sandbox.world import World
from kb.store.layout import Layout, parquet_files
from kb.store.rawlog.raw_files import RawKind, raw_files
from kb.store.state import tombstones
from tests.artifacts.rich_root import LEFT, STRANGE, add_everything
from tests.contract.conftest import Figureless as Job
from tests.faults import Sandbox


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Job]]:
    """Two machines with a part of a crawl each, scored by the tiny model."""
    world = World(n_channels=3, n_videos=24, n_posts=6, width=5, depth=3)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        jobs = [
            Job(sandbox, tmp_path_factory.mktemp(f"machine{number}"), toxicity=True)
            for number in (1, 2)
        ]
        for number, job in enumerate(jobs, 1):
            job.done("youtube", "crawl", "--part", f"{number}/2")
            job.done("youtube", "filter")
        jobs[0].done("reddit", "crawl")
        jobs[0].done("reddit", "filter")
        for number, job in enumerate(jobs, 1):
            add_everything(job, number)
        tombstones.add_tombstones(jobs[0].root, "youtube", [("nobody00001", "named")])
        yield jobs


def scored(root: Path) -> set[tuple[str, ...]]:
    files = parquet_files(Layout(root).annotations("youtube"))
    rows = pa.concat_tables([pq.read_table(file, columns=list(KEY)) for file in files])
    return {tuple(row.values()) for row in rows.to_pylist()}


@pytest.mark.slow
def test_every_command_works_on_roots_with_every_kind_of_file(
    parts: list[Job], tmp_path: Path
) -> None:
    home = Job(parts[0].sandbox, tmp_path / "home", toxicity=True)
    roots = [str(job.root) for job in parts]
    done = home.done("merge", *roots)
    assert scored(home.root) == scored(parts[0].root) | scored(parts[1].root)
    assert done["scores"] > 0
    assert done["labels"] == 3
    answers = {row["item_id"]: row["answer"] for row in stored(home.root).to_pylist()}
    assert answers == {"both": "no", "own1": "yes", "own2": "yes"}  # the newer one of a person
    litter = [name for name in (*LEFT, *STRANGE) if (home.root / name).exists()]
    assert litter == []
    assert not raw_files(home.root, "youtube", of=(RawKind.SET_ASIDE, RawKind.FOREIGN))
    assert len(raw_files(home.root, "wiki", of=(RawKind.CAPTURED,))) == 10
    again = home.done("merge", *roots)
    assert [again[name] for name in ("requests", "scores", "labels")] == [0, 0, 0]
    assert manifest.read_manifest(home.root, "annotations/youtube") is not None

    home.done("verify")
    for source in ("youtube", "wiki", "reddit"):
        home.done(source, "filter")
        home.done("annotate", source)
    home.done("build")
    gone = home.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")[0]["video_id"]
    (tmp_path / "ids.txt").write_text(f"{gone}\n")
    assert home.done("purge", "youtube", "--ids", str(tmp_path / "ids.txt"))["purged"] == 1
    (tmp_path / "ids.txt").write_text("10\n")
    home.done("purge", "wiki", "--ids", str(tmp_path / "ids.txt"))
    assert not (home.root / "raw/wiki/pages/10").exists()
    home.done("build")
    for words in (
        "youtube export", "wiki export", "reddit export", "release", "status", "index", "report",
        "links", "tasks", "pairs", "verify", "youtube export --format text", "query --tables",
        "build --plan",
    ):  # fmt: skip
        home.done(*words.split())
    assert json.dumps(home.done("verify")["found"]) == "[]"
