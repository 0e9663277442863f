"""The Data API: calls, quota, and what errors mean."""

import sqlite3
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest

from kb.core import clock, signals
from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.sandbox.server import Server
from kb.sandbox.world import World
from kb.sandbox.youtube.service import refusal
from pipelines import youtube
from tests.faults import Sandbox
from tests.sandbox.domains import of_case
from tests.youtube import walls
from tests.youtube.crawl.test_fetch import CRAWL, check, finish, no_patience
from tests.youtube.job import Job

SORRY = {"status": 403, "body": "<html>Sorry... automated queries</html>"}
ODD = {
    "status": 400,
    "body": {"error": {"code": 400, "message": "m", "errors": [{"reason": "badRequest"}]}},
}
TIMEOUT = {"status": 408, "body": "<html>Request Timeout</html>"}
BURST = {"status": 429, "body": refusal("burst_429")[1]}
LATER = "2027-01-10T12:00:00Z"


@pytest.mark.parametrize("what", [TIMEOUT, ODD], ids=["408", "400"])
def test_an_odd_answer_fails_a_pack_of_videos_and_drops_none(
    job: Job, what: dict[str, Any]
) -> None:
    no_patience(job).stopped(*CRAWL, "--limit", "5", code=3)
    job.sandbox.faults.add("/v3/videos", times=None, **what)
    summary = job.done(*CRAWL, code=4)
    left = len(job.sandbox.world.youtube.videos) - 5
    assert (summary["failed"], summary["crawled"], summary["pending"]) == (0, 0, left)
    assert len(job.sandbox.ledger.requests("/v3/videos")) == 1 + 4 * 2  # two tries each
    job.sandbox.faults.clear()
    finish(job)


def test_an_odd_answer_drops_no_keyword(job: Job) -> None:
    no_patience(job).sandbox.faults.add("/v3/search", times=2, **ODD)
    assert job.done(*CRAWL)["failed"] == 1
    finish(job)
    assert (
        len([seen for seen in job.sandbox.ledger.requests("/v3/search") if seen.status == 200]) == 6
    )


@pytest.mark.parametrize("path", ["/v3/search", "/v3/playlistItems", "/v3/videos"])
def test_a_refusal_without_a_reason_passes_with_time_only_where_it_says_so(
    job: Job, path: str
) -> None:
    job.sandbox.faults.add(path, headers={"Retry-After": "7200"}, **SORRY)
    assert job.done(*CRAWL, code=3)["waits_for"] == "service until 2026-11-20T14:00:00Z"
    job.sandbox.faults.add(path, times=None, **SORRY)
    assert job.done(*CRAWL, code=4)["waits_for"] == "person"
    assert len(job.sandbox.ledger.requests(path)) == 2
    job.sandbox.faults.clear()
    finish(job)


def test_payloads_without_their_newer_fields_go_on(job: Job) -> None:
    no_patience(job).stopped(*CRAWL, "--only", "channels", "--limit", "1", code=3)
    with sqlite3.connect(job.root / "state" / "youtube.sqlite") as state:
        fields = "'$.channels', '$.pages', '$.mark'"
        state.execute(f"UPDATE items SET payload = json_remove(payload, {fields})")
    finish(job)


@pytest.mark.parametrize(
    "what", [BURST, {"status": 403, "body": refusal("burst")[1]}], ids=["429", "403"]
)
def test_a_burst_without_end_is_a_block_and_found_out_by_one_request(
    job: Job, what: dict[str, Any]
) -> None:
    no_patience(job).sandbox.faults.add("/v3/videos", times=None, **what)
    file = job.place / "ids.txt"
    file.write_text("\n".join(list(job.sandbox.world.youtube.videos)[:10]))
    assert "Z" in job.stopped(*CRAWL, "--ids", str(file), code=3)
    before = len(job.sandbox.ledger)
    summary = job.done(*CRAWL, "--ids", str(file), code=3)
    assert (summary["failed"], summary["left"]) == (0, 10)
    assert len(job.sandbox.ledger) == before + 1
    job.sandbox.faults.clear()
    assert job.done(*CRAWL, "--ids", str(file))["crawled"] == 10


def test_a_refresh_is_blocked_as_well_and_counts_what_failed(job: Job) -> None:
    no_patience(job)
    job.profile(('playlist_keywords = ["Minecraft Tutorial", "Minecraft Guide"]\n', ""))
    total = job.done(*CRAWL)["crawled"]
    fault = job.sandbox.faults.add("/v3/videos", times=None, **BURST)
    before = len(job.sandbox.ledger)
    summary = job.done("refresh", "youtube", code=3, KB_NOW=LATER)
    assert (summary["failed"], summary["left"], len(job.sandbox.ledger)) == (0, total, before + 2)
    job.sandbox.faults.remove(fault)
    job.sandbox.faults.add("/v3/videos", times=None, status=404, body=refusal("no_playlist")[1])
    assert job.done("refresh", "youtube", KB_NOW=LATER, code=4)["failed"] == total
    job.sandbox.faults.clear()
    assert job.done("refresh", "youtube", KB_NOW=LATER)["crawled"] == total


@pytest.mark.parametrize(
    ("what", "code", "needs"),
    [
        ({"status": 429}, 3, "service until 2026-11-20T13:00:00Z"),  # nothing was said: an hour
        ({"status": 200, "body": walls.captcha_page()}, 4, "person"),
        (
            {"status": 429, "headers": {"Retry-After": "7200"}},
            3,
            "service until 2026-11-20T14:00:00Z",
        ),
    ],
    ids=["429", "captcha", "429 for hours"],
)
def test_after_a_block_one_video_finds_out_whether_it_stands(
    job: Job, what: dict[str, Any], code: int, needs: str
) -> None:
    no_patience(job)
    job.done(*CRAWL, "--only", "channels")
    job.done(*CRAWL, "--only", "playlists")
    job.done(*CRAWL, "--only", "uploads")
    job.done(*CRAWL, "--only", "metadata")
    job.sandbox.faults.add("/watch", times=None, **what)
    for requests in (8, 1, 1):
        before = len(job.sandbox.ledger)
        assert job.done(*CRAWL, "--workers", "4", code=code)["waits_for"] == needs
        assert len(job.sandbox.ledger) - before <= requests
    job.sandbox.faults.clear()
    finish(job)
    with sqlite3.connect(job.root / "state" / "youtube.sqlite") as state:
        assert state.execute(
            "SELECT count(*) FROM cursors WHERE name LIKE '%blocked%'"
        ).fetchone() == (0,)


@pytest.mark.parametrize(
    "what",
    [
        {"status": 302, "headers": {"Location": "/watch?v=again"}},
        {"status": 200, "headers": {"Content-Encoding": "gzip"}, "body": "no gzip"},
        {"status": 302, "headers": {"Location": "http://[::1"}},
        {"status": 302, "headers": {"Location": "http://127.0.0.2:9/elsewhere"}},
    ],
    ids=["circle", "bad gzip", "bad address", "another host"],
)
def test_one_odd_watch_page_is_one_failed_video(job: Job, what: dict[str, Any]) -> None:
    no_patience(job)
    video = of_case(job.sandbox.world.youtube, "manual")[0]
    job.sandbox.faults.add(f"/watch.v=({video.id}|again)", times=None, **what)
    summary = job.done(*CRAWL)
    assert (summary["failed"], summary["left"]) == (1, 0)
    job.sandbox.faults.clear()
    finish(job)


def test_an_empty_track_is_no_transcript(job: Job) -> None:
    video = next(
        video
        for video in of_case(job.sandbox.world.youtube, "manual")
        if [track.kind for track in video.tracks] == [""]
    )
    job.sandbox.faults.add(
        f"/timedtext.*{video.id}",
        times=None,
        status=200,
        body='<transcript><text start="0" dur="1"> </text></transcript>',
    )
    job.done(*CRAWL)
    assert [
        one["response"]["outcome"]
        for one in job.raw("transcripts")
        if one["response"]["video_id"] == video.id
    ] == ["none"]
    job.done("youtube", "filter")
    assert job.rows(
        f"SELECT stage, reason FROM clean.youtube_rejected WHERE key = '{video.id}'"
    ) == [{"stage": "transcript", "reason": "none"}]


def test_the_site_below_a_path(tmp_path: Path) -> None:
    """Game labels and sizes come from pages whose address begins with the root's own path."""
    sandbox = Sandbox(World(n_channels=9, n_videos=30), services=["youtube"])
    inner = sandbox.mounted("youtube")

    def below(environ: dict[str, Any], start: Any) -> Any:
        path = environ["PATH_INFO"]
        return inner(
            environ
            | {
                "PATH_INFO": path.removeprefix("/mirror/yt")
                if path.startswith("/mirror/yt/")
                else "/nowhere"
            },
            start,
        )

    sandbox.servers["youtube"] = Server(below)
    with sandbox:
        root = f"{sandbox.servers['youtube'].url}/mirror/yt"
        job = Job(sandbox, tmp_path, KB_YOUTUBE_ENDPOINT=root, KB_YOUTUBE_WEB=root)
        job.done(*CRAWL)
        check(job)
        found = [one["response"]["player"] for one in job.raw("transcripts")]
        assert any(one["game_label_id"] for one in found)
        assert any(one["fps"] for one in found)


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
        signals.stop.raise_if_asked()


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


def test_wait_with_a_set_date_sees_the_next_day(job: Job, hasty: None) -> None:
    status, body = refusal("general_spent")
    job.sandbox.faults.add("/v3/videos", status=status, body=body)
    assert job.done(*CRAWL, "--wait", KB_NOW="2026-11-21T07:59:59Z")["left"] == 0
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
    midnight = datetime.fromisoformat(last).replace(tzinfo=ZoneInfo("America/Los_Angeles"))
    assert timedelta(0) <= days.time - midnight < timedelta(minutes=2)
    # What one day's quota does whole is the same as what many days did.
    assert (
        youtube.crawl(run_with(few, tmp_path / "whole"), None, None, None)["crawled"]
        == summary["crawled"]
    )
