"""`--plan`: what a command would cost, of every command that asks a service;
nothing is sent or kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.server import Sandbox
from tests.reddit.conftest import small_world
from tests.youtube.job import Job

LATER = "2027-01-20T12:00:00Z"  # more than max_age_days after the crawl
PLANNED = ("youtube crawl", "wiki crawl", "reddit crawl", "refresh youtube", "refresh reddit")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    with Sandbox(small_world(24, width=120, depth=24)) as sandbox:
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
def test_before_the_first_crawl_it_says_what_was_assumed(tmp_path: Path, source: str) -> None:
    """No key, no service and no data root are needed, and none is made."""
    with Sandbox(small_world(24), services=["reddit"]) as sandbox:
        job = Job(sandbox, tmp_path)
        job.env.pop("KB_REDDIT_ENDPOINT")
        plan = planned(job, source, "crawl", REDDIT_CLIENT_ID="", YOUTUBE_API_KEY="")
        assert plan["requests"] > 100
        assert plan["hours"] > 0
        assert plan["gb"] > 0
        assert plan["assumed"]
        assert not job.root.exists()


def test_reddit(job: Job) -> None:
    job.done("reddit", "crawl", "--limit", "5", code=3)
    left = job.done("status")["sources"]["reddit"]["left_by"]
    phases = {phase["phase"]: phase for phase in planned(job, "reddit", "crawl")["phases"]}
    assert phases["listings"]["items"] == left["listings"]
    assert phases["posts"]["items"] >= left["posts"]
    job.done("reddit", "crawl")
    assert planned(job, "reddit", "crawl")["requests"] == 0
    plan = planned(job, "refresh", "reddit", KB_NOW=LATER)
    done = job.done("refresh", "reddit", KB_NOW=LATER)
    assert plan["phases"][0]["items"] == done["crawled"] > 100
    assert plan["requests"] == done["requests"] - 1, "and one for the token"
    assert planned(job, "refresh", "reddit", KB_NOW=LATER)["requests"] == 0
    job.done("reddit", "filter")
    job.done("reddit", "export")
    plan = planned(job, "reddit", "reconstruct")
    done = job.done("reddit", "reconstruct")
    assert plan["phases"][0]["items"] == done["crawled"]
    assert plan["requests"] == done["requests"] - 1


def test_youtube(job: Job) -> None:
    job.done("youtube", "crawl", "--only", "channels")
    plan = planned(job, "youtube", "crawl")
    assert [phase["phase"] for phase in plan["phases"]] == [
        "searches",
        "channels",
        "videos",
        "transcripts",
    ]
    job.done("youtube", "crawl")
    plan = planned(job, "refresh", "youtube", KB_NOW=LATER)
    done = job.done("refresh", "youtube", KB_NOW=LATER)
    assert (plan["requests"], plan["units"]) == (done["requests"], done["units"])
    assert plan["phases"][0]["items"] == done["crawled"] > 100


def test_for_people_it_is_a_table_by_phase(job: Job) -> None:
    shown = job.kb("youtube", "crawl", "--plan").stdout.splitlines()
    assert shown[0] == "youtube crawl --plan: nothing is sent"
    assert shown[1].split() == ["phase", "items", "requests", "units", "hours", "gb"]
    assert [line.split()[0] for line in shown[2:7]] == [
        "searches",
        "channels",
        "videos",
        "transcripts",
        "all",
    ]
    assert "units left today" in shown[7]


@pytest.mark.parametrize("words", PLANNED)
def test_help_names_it(job: Job, words: str) -> None:
    assert "--plan" in job.kb(*words.split(), "--help").stdout


@pytest.mark.parametrize(
    ("words", "idle"),
    [
        ("youtube crawl --limit 5", "--limit has"),
        ("youtube crawl --again --wait", "--wait and --again have"),
        ("youtube crawl --only uploads", "--only has"),
        ("youtube crawl --part 1/2", "--part has"),
        ("wiki crawl --limit 5", "--limit has"),
        ("reddit crawl --since 2026-01-01 --until 2026-02-01", "--since and --until have"),
        ("reddit reconstruct --out there", "--out has"),
        ("refresh youtube --limit 5", "--limit has"),
        ("refresh reddit --wait", "--wait has"),
        ("purge reddit --workers 2", "--workers has"),
    ],
)
def test_an_option_that_a_plan_leaves_out_is_refused(job: Job, words: str, idle: str) -> None:
    job.root.mkdir(exist_ok=True)
    said = job.stopped(*words.split(), "--plan", code=2)
    assert f"{idle} no effect on --plan" in said
    assert "leave" in said


def test_options_that_change_a_plan_are_taken(job: Job, tmp_path: Path) -> None:
    ids = tmp_path / "ids.txt"
    ids.write_text("".join(f"abcdefgh{number:03d}\n" for number in range(100)))
    whole = planned(job, "youtube", "crawl", "--ids", str(ids))
    half = planned(job, "youtube", "crawl", "--ids", str(ids), "--part", "1/2")
    assert 0 < half["videos"] < whole["videos"] == 100
    one = planned(job, "wiki", "crawl", "--workers", "1", KB_WIKI_URL="https://minecraft.wiki")
    assert "each of 1 browsers" in one["assumed"]


def test_a_plan_of_a_root_that_was_moved_writes_nothing(job: Job, tmp_path: Path) -> None:
    """The remembered file of the profile is beside the root, as before, at another place."""
    job.done("reddit", "crawl")
    shutil.copytree(job.place, tmp_path / "moved")
    root = tmp_path / "moved" / job.root.name
    profile = tmp_path / "moved" / "profile" / "profile.toml"

    def files() -> dict[str, tuple[int, bytes]]:
        # SQLite needs two files beside one that it reads, and leaves them.
        paths = [path for path in root.rglob("*") if path.is_file() and "sqlite-" not in path.name]
        return {str(path): (path.stat().st_mtime_ns, path.read_bytes()) for path in paths}

    before = files()
    for words in ("purge reddit", "reddit crawl", "refresh reddit"):
        moved = {"KB_DATA": str(root), "KB_PROFILE": str(profile)}
        job.done(*words.split(), "--plan", **moved)
        assert files() == before
