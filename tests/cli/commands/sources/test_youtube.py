"""Tests of `kb youtube`."""

from pathlib import Path

from tests.cli.commands.sources.conftest import first_plan, planned
from tests.youtube.job import Job

PHASES = ["searches", "channels", "videos", "transcripts"]


def test_a_plan_before_the_first_crawl(tmp_path: Path) -> None:
    first_plan(tmp_path, "youtube")


def test_a_plan_of_what_is_left(job: Job) -> None:
    job.done("youtube", "crawl", "--only", "channels")
    plan = planned(job, "youtube", "crawl")
    assert [phase["phase"] for phase in plan["phases"]] == PHASES
    shown = job.kb("youtube", "crawl", "--plan").stdout.splitlines()
    assert shown[1].split() == ["phase", "items", "requests", "units", "hours", "gb"]
    assert [line.split()[0] for line in shown[2:7]] == [*PHASES, "all"]
    assert "units left today" in shown[7]


def test_a_plan_of_named_videos_and_of_half_of_them(job: Job, tmp_path: Path) -> None:
    ids = tmp_path / "ids.txt"
    ids.write_text("".join(f"abcdefgh{number:03d}\n" for number in range(100)))
    all_videos = planned(job, "youtube", "crawl", "--ids", str(ids))
    half = planned(job, "youtube", "crawl", "--ids", str(ids), "--part", "1/2")
    assert 0 < half["videos"] < all_videos["videos"] == 100
