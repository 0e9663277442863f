"""Tests of `kb reddit`."""

from pathlib import Path

from tests.cli.commands.sources.conftest import first_plan, planned
from tests.youtube.job import Job


def test_a_plan_before_the_first_crawl(tmp_path: Path) -> None:
    first_plan(tmp_path, "reddit")


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
