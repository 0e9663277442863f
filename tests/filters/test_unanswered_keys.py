"""Keys without an answer count as failed."""

from pathlib import Path

from kb.filters.filter_run import run_clean
from kb.store.state.frontier import Frontier
from tests.filters.made import (
    rows,
    run_at,
)


def test_videos_that_the_crawl_gave_up_on_are_failed(root: Path) -> None:
    frontier = Frontier(root / "state" / "youtube.sqlite")
    frontier.add("videos", ["kept", "lost", "gone", "waiting"])
    for key in ("kept", "lost", "gone"):
        frontier.error("videos", key, "status_500")
    frontier.close()
    summary = run_clean(run_at(root), "youtube")
    assert (summary["crawled"], summary["failed"]) == (22, 3)
    assert rows(root, "failed")["lost"]["reason"] == "status_500"
    assert set(rows(root, "failed")) == {"lost", "broken", "badcues"}
