"""Tests of `kb wiki`."""

from pathlib import Path

from tests.cli.commands.sources.conftest import first_plan, planned
from tests.youtube.job import Job


def test_a_plan_before_the_first_crawl(tmp_path: Path) -> None:
    first_plan(tmp_path, "wiki")


def test_a_plan_depends_on_the_number_of_browsers(job: Job) -> None:
    plan = planned(job, "wiki", "crawl", "--workers", "1", KB_WIKI_URL="https://minecraft.wiki")
    assert "each of 1 browsers" in plan["assumed"]
