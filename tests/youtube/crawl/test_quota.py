"""A crawl of several quota days with --wait: the days pass on a clock of the test's own, everything
else is real.
"""

import sqlite3
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from kb.core import clock, signals
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.sandbox.youtube.service import refusal
from kb.youtube.crawl.quota import PACIFIC
from pipelines import youtube
from tests.faults import Sandbox
from tests.youtube.crawl.test_fetch import CRAWL
from tests.youtube.job import Job

UNITS, SEARCHES = 4, 2


class Days:
    """A clock whose time passes by sleeping only."""

    def __init__(self, now: datetime) -> None:
        self.time = now
        self._lock = threading.Lock()  # both services sleep

    def now(self) -> datetime:
        return self.time

    def sleep(self, seconds: float) -> None:
        with self._lock:
            self.time += timedelta(seconds=max(0.0, seconds))  # as the real one
        signals.stop.check()


@pytest.fixture
def days(monkeypatch: pytest.MonkeyPatch) -> Days:
    # A day with 25 hours in California, an hour before it ends.
    made = Days(datetime(2026, 11, 2, 7, 0, tzinfo=UTC))
    monkeypatch.delenv("KB_NOW", raising=False)
    monkeypatch.setattr(clock, "now", made.now)
    monkeypatch.setattr(clock, "sleep", made.sleep)
    return made


def run_with(sandbox: Sandbox, root: Path, wait: bool = False, **limits: int) -> Run:
    profile = load_profile("minecraft")
    assert profile.youtube is not None
    profile = profile.model_copy(update={"youtube": profile.youtube.model_copy(update=limits)})
    settings = load_settings(
        dotenv=False, **{key.lower(): value for key, value in sandbox.settings(model=False).items()}
    )
    return Run(settings=settings, profile=profile, root=root, workers=2, wait=wait)


def test_wait_sleeps_as_long_as_the_service_asks(few: Sandbox, tmp_path: Path, days: Days) -> None:
    for path in ("/v3/videos", "/watch"):
        few.faults.add(path, status=429, headers={"Retry-After": "4000"})
    start = days.time
    summary = youtube.crawl(run_with(few, tmp_path, wait=True), None, None, None)
    assert (summary["left"], summary["failed"]) == (0, 0)
    assert days.time - start >= timedelta(seconds=8000)


def test_wait_with_a_set_date_sees_the_next_day(job: Job) -> None:
    status, body = refusal("general_spent")
    job.sandbox.faults.add("/v3/videos", status=status, body=body)
    assert job.done(*CRAWL, "--wait", KB_NOW="2026-11-21T07:59:58Z")["left"] == 0
    with sqlite3.connect(job.root / "state" / "youtube.sqlite") as state:
        days = state.execute(
            "SELECT DISTINCT day FROM ledger WHERE bucket = 'general' ORDER BY day"
        ).fetchall()
    assert days == [("2026-11-20",), ("2026-11-21",)]


def test_wait_goes_on_after_each_reset_and_never_overspends(
    few: Sandbox, tmp_path: Path, days: Days
) -> None:
    summary = youtube.crawl(
        run_with(few, tmp_path, wait=True, units_per_day=UNITS, searches_per_day=SEARCHES),
        None,
        None,
        None,
    )
    assert (summary["left"], summary["failed"]) == (0, 0)
    with sqlite3.connect(tmp_path / "state" / "youtube.sqlite") as state:
        rows = state.execute("SELECT bucket, day, sum(units) FROM ledger GROUP BY bucket, day")
        spent = rows.fetchall()
    by_day = {day: units for bucket, day, units in spent if bucket == "general"}
    assert len(by_day) > 2, "the crawl did not last for days"
    assert max(by_day.values()) == UNITS
    assert max(units for bucket, _, units in spent if bucket == "search") <= SEARCHES
    # It slept to each midnight in California and no further.
    last = max(by_day)
    midnight = datetime.fromisoformat(last).replace(tzinfo=PACIFIC)
    assert timedelta(0) <= days.time - midnight < timedelta(minutes=2)
    # What one day's quota does whole is the same as what many days did.
    assert (
        youtube.crawl(run_with(few, tmp_path / "whole"), None, None, None)["crawled"]
        == summary["crawled"]
    )
