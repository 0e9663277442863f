"""A small sandbox with a data root, and the plans of commands on it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.youtube.job import Job

LATER = "2027-01-20T12:00:00Z"  # more than max_age_days after the crawl


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


def first_plan(place: Path, source: str) -> None:
    """A plan before the first crawl names its assumptions, needs no key and no data root, and
    makes none.
    """
    with Sandbox(small_world(24), services=["reddit"]) as sandbox:
        job = Job(sandbox, place)
        job.env.pop("KB_REDDIT_ENDPOINT")
        plan = planned(job, source, "crawl", REDDIT_CLIENT_ID="", YOUTUBE_API_KEY="")
    assert plan["requests"] > 100
    assert plan["hours"] > 0
    assert plan["gb"] > 0
    assert plan["assumed"]
    assert not job.root.exists()
