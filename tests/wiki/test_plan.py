"""Tests of the estimate of a crawl."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from kb.wiki.crawl.connector import plan_crawl


def test_named_titles_are_asked_for_fifty_at_a_time(
    run_on: Callable[..., Any], tmp_path: Path
) -> None:
    titles = tmp_path / "titles.txt"
    titles.write_text("".join(f"Page {number}\n" for number in range(120)))
    run = run_on(tmp_path / "data", "https://wiki.example", wiki={"seconds_between": 2.0})
    plan = plan_crawl(run, titles)
    phases = {phase["phase"]: phase for phase in plan["phases"]}
    assert (phases["titles"]["items"], phases["titles"]["requests"]) == (120, 3)
    assert phases["pages"]["items"] == 120
    assert phases["image files"]["items"] > 0
    assert any("2 s between requests" in line for line in plan["assumed"].split(", ")), plan
    assert not run.root.exists()
