"""Tests of `kb.core.summary.plan`."""

from kb.core.summary import Summary
from kb.core.summary.plan import PlanPart, PlanPhase, join, to_read


def test_a_plan_sums_its_phases_and_shows_them_in_columns() -> None:
    videos = PlanPart([PlanPhase("videos", 1_200, requests=24, units=24)], ["50 ids a request"])
    posts = PlanPart([PlanPhase("posts", 10, requests=1, hours=0.5, gb=0.25)])
    made = join("restore", [videos, posts])
    assert (made["requests"], made["units"], made["hours"], made["gb"]) == (25, 24, 0.5, 0.25)
    lines = Summary(made).line().splitlines()
    assert lines[0] == "restore --plan: nothing is sent"
    assert lines[1].split() == ["phase", "items", "requests", "units", "hours", "gb"]
    assert lines[2].split() == ["videos", "1,200", "24", "24", "0.0", "0"]
    assert lines[4].split() == ["all", "25", "24", "0.5", "0.25"]
    assert len({len(line) for line in lines[1:5]}) == 1
    assert lines[5] == "  assumed: 50 ids a request"


def test_items_that_failed_are_read_again() -> None:
    kinds = {"videos": {"todo": 2, "in_progress": 1, "error": 3, "done": 5, "skipped": 7}}
    assert (to_read(kinds, "videos"), to_read(kinds, "pages")) == (6, 0)
