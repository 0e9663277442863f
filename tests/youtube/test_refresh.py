"""Old statistics are read again, what vanished is marked and can be purged; --wait sleeps through
what the service asks.
"""

from __future__ import annotations

from tests.youtube.job import Job
from tests.youtube.test_faults import CRAWL, check

LATER = "2027-01-10T12:00:00Z"


def test_what_is_too_old_is_read_again_fifty_a_unit(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    assert job.done("refresh", "youtube")["crawled"] == 0  # nothing is old yet
    kept = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    changed, gone = kept[0]["video_id"], kept[1]["video_id"]
    world = job.sandbox.world.youtube.videos
    world[changed].view_count = "424242"
    world[gone].in_api = False
    assert job.done("status", KB_NOW=LATER)["too_old"] == len(kept)

    before = len(job.sandbox.ledger)
    summary = job.done("refresh", "youtube", KB_NOW=LATER)
    paths = {seen.path.rsplit("/", 1)[-1] for seen in job.sandbox.ledger.requests(since=before)}
    assert paths == {"videos"}  # no transcript is asked for again
    assert summary["units"] == -(-summary["crawled"] // 50)
    job.done("youtube", "filter", KB_NOW=LATER)
    assert job.rows(
        f"SELECT view_count FROM clean.youtube_videos WHERE video_id = '{changed}'"
    ) == [{"view_count": 424242}]
    assert job.rows(f"SELECT stage FROM clean.youtube_rejected WHERE key = '{gone}'") == [
        {"stage": "missing"}
    ]
    assert job.done("status", KB_NOW=LATER)["too_old"] == 0
    assert job.done("refresh", "youtube", KB_NOW=LATER)["crawled"] == 0

    job.done("purge", "youtube", KB_NOW=LATER)
    assert job.rows(f"SELECT count(*) AS n FROM clean.youtube_rejected WHERE key = '{gone}'") == [
        {"n": 0}
    ]


def test_everything_may_be_read_again_now_and_goes_on_where_it_stopped(job: Job) -> None:
    known = job.done(*CRAWL)["crawled"]
    before = len(job.sandbox.ledger)
    words = ("refresh", "youtube", "--older-than", "0")
    assert job.done("refresh", "youtube", "--older-than", "1")["crawled"] == 0
    assert job.done(*words, "--limit", "10", code=3)["crawled"] == 10
    asked = [
        key
        for seen in job.sandbox.ledger.requests("/youtube/v3/videos", since=before)
        for key in seen.args["id"].split(",")
    ]
    second = job.done(*words)
    everything = [
        key
        for seen in job.sandbox.ledger.requests("/youtube/v3/videos", since=before)
        for key in seen.args["id"].split(",")
    ]
    assert (len(asked), second["crawled"]) == (10, len(everything) - 10)
    assert len(everything) == len(set(everything)) >= known
    assert job.done(*words)["crawled"] == len(everything)


def test_a_state_that_a_refresh_made_again_still_asks_for_transcripts(job: Job) -> None:
    for phase in ("channels", "uploads", "metadata"):
        job.done(*CRAWL, "--only", phase)
    (job.root / "state/youtube.sqlite").unlink()
    job.done("refresh", "youtube")  # takes the answers in, and has no use for transcripts
    first = job.done(*CRAWL)
    assert first["transcripts_asked"] > 0
    job.done("youtube", "filter")
    assert job.rows("SELECT count(*) AS n FROM clean.youtube_transcripts")[0]["n"] > 0
    whole = Job(job.sandbox, job.place / "whole").done(*CRAWL)
    assert first["transcripts_asked"] == whole["transcripts_asked"]


def test_the_next_crawl_asks_for_what_a_refresh_found_worth_it(job: Job) -> None:
    """A video without views gets them later: its transcript is had, and no other again."""
    job.done(*CRAWL)
    job.done("youtube", "filter")
    low = job.rows("SELECT key FROM clean.youtube_rejected WHERE stage = 'views'")[0]["key"]
    job.sandbox.world.youtube.videos[low].view_count = "424242"
    job.done("refresh", "youtube", KB_NOW=LATER)
    before = len(job.raw("transcripts"))
    assert job.done(*CRAWL, KB_NOW=LATER)["left"] == 0
    assert [one["response"]["video_id"] for one in job.raw("transcripts")[before:]] == [low]


def test_wait_sleeps_through_a_burst_and_ends_whole(job: Job) -> None:
    job.sandbox.faults.add(
        "/youtube/v3/videos",
        status=429,
        times=1,
        headers={"Retry-After": "1"},
        body={
            "error": {
                "code": 429,
                "errors": [{"reason": "rateLimitExceeded"}],
                "message": "slow down",
            }
        },
    )
    job.done(*CRAWL, "--wait")
    check(job)
