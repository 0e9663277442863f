"""What a command makes: the same bytes by one worker, by two, and by a cluster of which a worker is
killed; on another processor, too.
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import zstandard

from kb.annotate import toxicity
from kb.annotate.toxicity import ToxicityScorer
from kb.artifacts.makers import make_and_export, make_artifact
from kb.core import clock
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.filters.filter_run import run_clean, texts
from kb.pairs import build
from kb.reddit.crawl.importer import import_dumps
from kb.reddit.parse.anonymize import load_key
from kb.sandbox.toxicity import tiny_checkpoint
from kb.sandbox.world import World
from kb.store.tables import partition
from tests.annotate.demo_texts import WORDS
from tests.annotate.least import LIMITS
from tests.conftest import needs
from tests.faults import Sandbox
from tests.pairs.made import fill, tables
from tests.wiki.handmade_data import MONDAY, many, page, put, refused, told
from tests.youtube.job import NOW, Job

needs("distributed", "torch", "detoxify")

PAGES, FILES, COMMENTS = 150, 10, 1500
# Half an hour beyond a whole zone; a locale whose comma and dotless i trip what asks for one.
ELSEWHERE = {"TZ": "Asia/Kolkata", "LC_ALL": "tr_TR.UTF-8", "PYTHONHASHSEED": "77", **LIMITS}
MADE = ("clean", "annotations", "pairs", "links", "release")


@pytest.fixture(scope="module")
def crawled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """Raw data of a small world of videos."""
    with Sandbox(World(n_channels=6, n_videos=40), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("crawled"), toxicity=True)
        job.done("youtube", "crawl")
        yield job


@pytest.fixture(scope="module")
def given(crawled: Job, tmp_path_factory: pytest.TempPathFactory, make_rows) -> Path:
    """A folder for each command with what its data root begins with, and dumps of Reddit."""
    place = tmp_path_factory.mktemp("given")
    for name in ("raw", "state"):
        shutil.copytree(crawled.root / name, place / "youtube" / name)
    many(place / "wiki", PAGES)
    absent = {"ns": 0, "title": "Nowhere", "missing": True}
    put(place / "wiki", "pages", (MONDAY, told(page(1, "Broken"), absent)))
    put(place / "wiki", "renders", (MONDAY, refused(1, "Broken", "failed", "too_tall")))
    words = ["creeper", "oak log", "iron golem"]
    fill(place / "pairs", *tables(80, 400, words, share=0.06), make_rows)
    load_key(place / "reddit")
    (place / "dumps").mkdir()
    for month in range(FILES):
        lines = "".join(json.dumps(comment(month, n)) + "\n" for n in range(COMMENTS))
        data = zstandard.ZstdCompressor().compress(lines.encode())
        (place / "dumps" / f"RC_2020-{month + 1:02d}.zst").write_bytes(data)
    (place / "texts").mkdir()
    return place


def comment(month: int, n: int) -> dict[str, object]:
    return {
        "id": f"c{month:02d}{n:04d}",
        "body": f"comment {n} about creepers " * 8,
        "author": f"p{n % 37}",
        "subreddit": "Minecraft" if n % 3 else "elsewhere",
        "link_id": f"t3_p{n // 20}",
        "parent_id": f"t3_p{n // 20}",
        "created_utc": 1_600_000_000 + n,
        "retrieved_on": 1_600_100_000,
        "score": n,
    }


def youtube(run: Run, given: Path) -> None:
    summary = run_clean(run, "youtube")
    assert summary["kept"] > 10
    assert summary["rejected"] > 20
    make_artifact(run, "release/youtube")


def wiki(run: Run, given: Path) -> None:
    summary = run_clean(run, "wiki")
    assert summary["kept"] + summary["stages"].get("toxicity", 0) == PAGES
    assert summary["rejected"] + summary["failed"] == summary["crawled"] - summary["kept"]


def annotate(run: Run, given: Path) -> None:
    """What `kb annotate wiki` does."""
    assert ToxicityScorer.open(run, "wiki").annotate(texts(run, "wiki")).scored == PAGES
    assert not list((run.root / "clean").iterdir())


def score(run: Run, given: Path) -> None:
    rng = clock.rng("texts of the engine test")
    said = [*WORDS["plain"], *WORDS["harmless"], *WORDS["kinds"]["insult"]]
    scored = [" ".join(rng.choices(said, k=rng.randint(1, 40))) for _ in range(600)]
    counts = ToxicityScorer.open(run, "reddit").annotate([scored])
    assert counts.scored == len(set(scored))


def pairs(run: Run, given: Path) -> None:
    made = make_and_export(run, "pairs")
    assert made["videos"] == 80
    assert made["pairs"] > 100


def reddit(run: Run, given: Path) -> None:
    counts = import_dumps(run, sorted((given / "dumps").iterdir()))
    assert counts["crawled"] == FILES * COMMENTS * 2 // 3


class Command(NamedTuple):
    """`make` in a root that begins with a folder of `given`; what it `writes`; the first file of
    the kind `begun` shows that tasks were finished: the moment when a worker is killed.
    """

    make: Callable[[Run, Path], None]
    begins: str
    writes: tuple[str, ...]
    begun: str


COMMANDS = [
    Command(
        youtube,
        "youtube",
        ("clean/youtube", "annotations", "release/youtube"),
        "clean/.youtube.new/**/*.parquet",
    ),
    Command(wiki, "wiki", ("clean", "annotations"), "clean/.wiki.new/**/*.parquet"),
    Command(annotate, "wiki", ("annotations",), "clean/.wiki.work/**/texts-*.arrow"),
    Command(score, "texts", ("annotations",), "annotations/reddit/part-*.parquet"),
    Command(pairs, "pairs", ("pairs", "release/pairs"), ".pairs.new/.parts/*.parquet"),
    Command(reddit, "reddit", ("raw",), "raw/**/*.zst"),
]


@pytest.mark.dask
@pytest.mark.parametrize("command", COMMANDS, ids=lambda one: one.make.__name__)
def test_every_engine_makes_the_same_bytes(
    command: Command, given, cluster, kill_a_worker, tmp_path, monkeypatch
) -> None:
    # A small crawl is cut into as many tasks as a large one.
    monkeypatch.setenv("KB_NOW", NOW)
    monkeypatch.setattr(partition, "RAW_BYTES", 12_000 if command.make is youtube else 300_000)
    monkeypatch.setattr(build, "_ROWS", 5)
    monkeypatch.setattr(toxicity, "CHUNK_TEXTS", 40)
    settings = load_settings(dotenv=False, kb_toxicity_model=str(tiny_checkpoint()))

    def made(name: str, **options) -> dict[str, str]:
        root = Path(shutil.copytree(given / command.begins, tmp_path / name))
        command.make(Run(settings, load_profile("minecraft"), root, **options), given)
        return {
            str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
            for top in command.writes
            for path in sorted((root / top).rglob("*"))
            if path.is_file()
        }

    expected = made("one", workers=1)
    assert expected
    assert made("two", workers=2) == expected
    killed = kill_a_worker(lambda: any((tmp_path / "dask").glob(command.begun)))
    assert made("dask", workers=2, engine="dask", scheduler=cluster.scheduler_address) == expected
    assert killed, "no worker was killed"


@pytest.mark.dask
def test_a_build_on_a_cluster_makes_what_one_machine_makes(crawled: Job, cluster, tmp_path) -> None:
    def made(place: Path, *engine: str) -> dict[str, str]:
        job = Job(crawled.sandbox, place, toxicity=True)
        for name in ("raw", "state"):
            shutil.copytree(crawled.root / name, job.root / name)
        assert job.done("build", *engine)["made"] > 5
        assert job.done("build", *engine)["made"] == 0
        tops = (*MADE, "tasks", "report")
        return {f"{top}/{name}": at for top in tops for name, at in job.digests(top).items()}

    words = ("--engine", "dask", "--scheduler", cluster.scheduler_address)
    assert made(tmp_path / "dask", *words) == made(tmp_path / "here")


@pytest.mark.slow
def test_another_processor_locale_time_zone_hash_seed_and_number_of_workers(
    crawled: Job, tmp_path
) -> None:
    def made(place: Path, workers: str, **env: str) -> dict[str, str]:
        job = Job(crawled.sandbox, place, toxicity=True, fresh=bool(env), **env)
        for name in ("raw", "state"):
            shutil.copytree(crawled.root / name, job.root / name)
        job.done("build", "release", "--workers", workers)
        return {f"{top}/{name}": at for top in MADE for name, at in job.digests(top).items()}

    here = made(tmp_path / "here", "1")
    assert any(name.startswith("release/pairs") for name in here), sorted(here)
    assert any(name.startswith("annotations") for name in here)
    assert made(tmp_path / "elsewhere", "2", **ELSEWHERE) == here
