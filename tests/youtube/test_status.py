"""What `kb status` says of YouTube's quota."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.store.state.frontier import Frontier
from kb.youtube.crawl import quota
from kb.youtube.crawl.reduce import TRANSCRIPTS
from kb.youtube.parse.answers import PO_TOKEN
from kb.youtube.status import status


def test_units_of_all_days_and_what_is_left_of_today(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = load_profile("minecraft")
    run = Run(load_settings(dotenv=False), profile, tmp_path)
    frontier = Frontier(tmp_path / "youtube.sqlite")
    monkeypatch.setenv("KB_NOW", "2026-11-19T12:00:00Z")
    quota.spend(frontier, profile.section("youtube"), quota.GENERAL, "videos.list")
    monkeypatch.setenv("KB_NOW", "2026-11-20T12:00:00Z")
    for bucket in (quota.GENERAL, quota.SEARCH, quota.SEARCH):
        quota.spend(frontier, profile.section("youtube"), bucket, "x")
    frontier.add(TRANSCRIPTS, ["a", "b"])
    frontier.skip(TRANSCRIPTS, "a", PO_TOKEN)
    found = status(run, frontier)
    frontier.close()
    assert (found["units"], found["po_token"]) == (4, 1)
    assert {name: one["spent"] for name, one in found["quota"].items()} == {
        quota.GENERAL: 1,
        quota.SEARCH: 2,
        quota.STATISTICS: 0,
    }
    assert all(one["spent"] + one["left"] == one["limit"] for one in found["quota"].values())
    assert {one["resets_at"] for one in found["quota"].values()} == {"2026-11-21T08:00:00Z"}
