"""What earlier versions wrote is read, built, verified, purged and restored by this one."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import kb
from kb.artifacts.data_roots import FORMAT
from kb.sandbox.world import World
from kb.store.layout import Layout
from tests.contract.conftest import Figureless
from tests.faults import Sandbox
from tests.kept.make import FOLDER, NOBODY, WORLD

ARCHIVES = sorted(FOLDER.glob("*.tar.xz"))


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    """The world that the roots were made from."""
    with Sandbox(World(**WORLD), services=["youtube", "reddit"]) as running:
        yield running


@pytest.fixture(scope="module", params=ARCHIVES, ids=lambda path: path.name)
def unpacked(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the data root of a version, never written to."""
    place = tmp_path_factory.mktemp("kept")
    shutil.unpack_archive(request.param, place)
    return place


@pytest.fixture
def job(unpacked: Path, sandbox: Sandbox, tmp_path: Path) -> Figureless:
    """A copy of the data root, and commands on it."""
    shutil.copytree(unpacked, tmp_path / "place")
    return Figureless(sandbox, tmp_path / "place", toxicity=True)


def count(job: Figureless, sql: str) -> int:
    """The only number of a query's answer."""
    ((number,),) = [tuple(row.values()) for row in job.rows(sql)]
    return int(number)


def test_a_kept_root_is_read_and_verified(job: Figureless) -> None:
    assert count(job, "SELECT count(*) FROM clean.youtube_videos") > 0
    assert job.done("verify")["found"] == []
    job.done("status")
    job.done("status", "--runs")
    assert job.done("search", "minecraft")["answers"] != 0
    assert kb.load(job.root)["pairs"].count_rows() > 0


def test_a_kept_root_is_built_anew_with_the_same_rows(job: Figureless) -> None:
    names = ("youtube_videos", "reddit_posts", "wiki_pages", "pairs", "tasks")
    before = {name: count(job, f"SELECT count(*) FROM {name}") for name in names}
    for name in ("clean", "pairs", "links", "tasks", "index", "release/youtube", "release/pairs"):
        shutil.rmtree(job.root / name)
    job.done("build")
    assert {name: count(job, f"SELECT count(*) FROM {name}") for name in names} == before
    assert job.done("verify")["found"] == []
    assert job.done("build")["made"] == 0
    known = {row["answer"] for row in job.rows("SELECT answer FROM labels")}
    assert known == {"yes"}


def test_a_crawl_and_a_purge_go_on_in_a_kept_root(job: Figureless) -> None:
    sent = len(job.sandbox.ledger)
    job.done("youtube", "crawl")
    assert len(job.sandbox.ledger) == sent, "the state says that nothing is left"
    film = next(path.parent.name for path in Layout(job.root).films.glob("*/film.npz"))
    (job.place / "gone.txt").write_text(f"{film}\n{NOBODY}\n")
    summary = job.done("purge", "youtube", "--ids", "gone.txt")
    assert (summary["purged"], summary["known"]) == (1, 1)
    job.done("build")
    assert not (Layout(job.root).films / film).exists()
    assert count(job, f"SELECT count(*) FROM pairs WHERE video_id = '{film}'") == 0
    assert job.done("verify")["found"] == []


def test_a_kept_release_is_verified_loaded_and_restored(job: Figureless) -> None:
    download = job.place / "download"
    shutil.copytree(job.root / "release", download)
    job.done("verify", str(download))
    wanted = count(job, "SELECT count(*) FROM release.youtube_videos")
    assert kb.load(download)["youtube_videos"].count_rows() == wanted
    home = Figureless(job.sandbox, job.place / "home", toxicity=True)
    done = home.done("restore", str(download / "youtube"))
    assert done["missing"] == 0
    assert count(home, "SELECT count(*) FROM restored.youtube_videos") == wanted


@pytest.mark.parametrize(
    "words",
    [
        *("status", "query 'SELECT 1'", "youtube crawl", "youtube filter", "youtube export"),
        *("build", "build --plan", "purge youtube --ids ids.txt", "refresh youtube", "update"),
        *("verify", "verify --repair", "pairs", "release", "report", "search word", "merge other"),
        *("reddit import dump.ndjson", "annotate youtube", "label import answers.json"),
    ],
)
def test_a_root_of_a_newer_version_is_refused_by_one_line(
    unpacked: Path, sandbox: Sandbox, tmp_path: Path, words: str
) -> None:
    place = tmp_path / "place"
    (place / "data" / "state").mkdir(parents=True)
    shutil.copytree(unpacked / "data" / "raw", place / "data" / "raw")
    for name in ("ids.txt", "dump.ndjson", "answers.json"):
        (place / name).write_text("{}\n")
    noted = {"name": "minecraft", "format": FORMAT + 1}
    (place / "data" / "state" / "profile.json").write_text(json.dumps(noted))
    job = Figureless(sandbox, place, toxicity=True)
    before = job.digests()
    line = job.stopped(*words.replace("'", "").split(" ", 1 if "SELECT" in words else -1), code=2)
    assert "a newer Lorecrawl wrote the data root" in line
    assert "upgrade Lorecrawl" in line
    assert job.digests() == before


def test_python_refuses_a_root_of_a_newer_version(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "profile.json").write_text(f'{{"name": "x", "format": {FORMAT + 1}}}')
    with pytest.raises(Exception, match="a newer Lorecrawl wrote"):
        kb.load(tmp_path)
