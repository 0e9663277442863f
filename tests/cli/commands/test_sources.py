"""Plans and crawls of the three sources at the command line, in a small sandbox."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.world import World
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.youtube.job import Job

PHASES = ["searches", "channels", "playlists", "videos", "transcripts"]
LATER = "2027-01-20T12:00:00Z"  # more than max_age_days after the crawl


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    world = World(n_channels=9, n_videos=130)
    world.reddit = small_world(24, width=120, depth=24).reddit
    with Sandbox(world) as sandbox:
        yield Job(sandbox, tmp_path_factory.mktemp("plans"))


def planned(job: Job, *words: str, **env: str) -> dict[str, Any]:
    """The plan as JSON; nothing was asked of any service for it."""
    before = len(job.sandbox.ledger)
    plan = job.done(*words, "--plan", **env)
    assert len(job.sandbox.ledger) == before
    assert plan["command"] == f"{' '.join(words[:2])} --plan"
    for name in ("requests", "hours"):
        total = sum(phase[name] for phase in plan["phases"])
        assert plan[name] == pytest.approx(total, abs=0.05)
    return plan


@pytest.mark.parametrize("source", ["youtube", "wiki", "reddit"])
def test_a_plan_before_the_first_crawl(tmp_path: Path, source: str) -> None:
    """It names its assumptions, needs no key and no data root, and makes none."""
    with Sandbox(small_world(24), services=["reddit"]) as sandbox:
        job = Job(sandbox, tmp_path)
        job.env.pop("KB_REDDIT_ENDPOINT")
        plan = planned(job, source, "crawl", REDDIT_CLIENT_ID="", YOUTUBE_API_KEY="")
    assert plan["requests"] > 100
    assert plan["hours"] > 0
    assert plan["gb"] > 0
    assert plan["assumed"]
    assert not job.root.exists()


def test_a_plan_of_what_is_left(job: Job) -> None:
    job.done("youtube", "crawl", "--only", "channels")
    plan = planned(job, "youtube", "crawl")
    assert [phase["phase"] for phase in plan["phases"]] == PHASES
    shown = job.kb("youtube", "crawl", "--plan").stdout.splitlines()
    assert shown[1].split() == ["phase", "items", "requests", "units", "hours", "gb"]
    assert [line.split()[0] for line in shown[2:8]] == [*PHASES, "all"]
    assert "units left today" in shown[8]


def test_a_plan_of_named_videos_and_of_half_of_them(job: Job, tmp_path: Path) -> None:
    ids = tmp_path / "ids.txt"
    ids.write_text("".join(f"abcdefgh{number:03d}\n" for number in range(100)))
    all_videos = planned(job, "youtube", "crawl", "--ids", str(ids))
    half = planned(job, "youtube", "crawl", "--ids", str(ids), "--part", "1/2")
    assert 0 < half["videos"] < all_videos["videos"] == 100


def test_a_plan_depends_on_the_number_of_browsers(job: Job) -> None:
    plan = planned(job, "wiki", "crawl", "--workers", "1", KB_WIKI_URL="https://minecraft.wiki")
    assert "each of 1 browsers" in plan["assumed"]


def test_plans_of_a_crawl_and_a_reconstruction(job: Job) -> None:
    job.done("reddit", "crawl", "--limit", "5", code=3)
    left = job.done("status")["sources"]["reddit"]["left_by"]
    phases = {phase["phase"]: phase for phase in planned(job, "reddit", "crawl")["phases"]}
    assert phases["listings"]["items"] == left["listings"]
    assert phases["posts"]["items"] >= left["posts"]
    job.done("reddit", "crawl")
    assert planned(job, "reddit", "crawl")["requests"] == 0
    job.done("reddit", "filter")
    job.done("reddit", "export")
    plan = planned(job, "reddit", "reconstruct")
    done = job.done("reddit", "reconstruct")
    assert plan["phases"][0]["items"] == done["crawled"]
    assert plan["requests"] == done["requests"] - 1, "and one for the token"
