"""Tests of `kb refresh`."""

import pytest

from tests.cli.commands.sources.conftest import LATER, planned
from tests.youtube.job import Job


@pytest.mark.parametrize("source", ["youtube", "reddit"])
def test_a_refresh_costs_what_its_plan_says(job: Job, source: str) -> None:
    job.done(source, "crawl")
    plan = planned(job, "refresh", source, KB_NOW=LATER)
    done = job.done("refresh", source, KB_NOW=LATER)
    assert plan["phases"][0]["items"] == done["crawled"] > 100
    token = 1 if source == "reddit" else 0  # a request for it
    assert plan["requests"] == done["requests"] - token
    assert plan["units"] == done.get("units", 0)
    assert planned(job, "refresh", source, KB_NOW=LATER)["requests"] == 0


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
