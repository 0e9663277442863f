"""Old statistics are read again, what vanished is marked and can be purged; --wait sleeps through
what the service asks.
"""

from tests.youtube.crawl.test_fetch import CRAWL, check
from tests.youtube.job import Job

LATER = "2027-01-10T12:00:00Z"
SOON = "2026-11-29T12:00:00Z"  # metadata may be as old, counts have changed
COUNTS, FULL = "/youtube/v3/videos:batchGetStats", "/youtube/v3/videos"


def asked(job: Job, path: str, since: int) -> list[list[str]]:
    """The ids of each request for `path`."""
    requests = job.sandbox.ledger.requests(since=since)
    return [seen.args["id"].split(",") for seen in requests if seen.path == path]


def test_metadata_that_are_too_old_are_read_again_in_full(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    assert job.done("refresh", "youtube")["crawled"] == 0  # nothing is old yet
    kept = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    changed, gone = kept[0]["video_id"], kept[1]["video_id"]
    world = job.sandbox.world.youtube.videos
    world[changed].view_count = "424242"
    world[changed].title += " (edited)"
    world[gone].in_api = False
    assert job.done("status", KB_NOW=LATER)["too_old"] == len(kept)

    plan = job.done("refresh", "youtube", "--plan", KB_NOW=LATER)["phases"]
    before = len(job.sandbox.ledger)
    summary = job.done("refresh", "youtube", KB_NOW=LATER)
    calls = asked(job, FULL, before)
    in_full = [key for keys in calls for key in keys]
    assert not asked(job, COUNTS, before)
    assert [phase["items"] for phase in plan[:2]] == [len(in_full), 0]
    assert plan[0]["units"] == len(calls) == -(-len(in_full) // 50)
    missing = {key for key in in_full if not world[key].in_api}
    assert gone in missing
    assert (summary["crawled"], summary["missing"]) == (len(in_full), len(missing))
    job.done("youtube", "filter", KB_NOW=LATER)
    columns = "title, view_count, fetched_at = counted_at AS at_once"
    assert job.rows(f"SELECT {columns} FROM clean.youtube_videos WHERE video_id = '{changed}'") == [
        {"title": world[changed].title, "view_count": 424242, "at_once": True}
    ]
    assert job.rows(f"SELECT stage FROM clean.youtube_rejected WHERE key = '{gone}'") == [
        {"stage": "missing"}
    ]
    assert job.done("status", KB_NOW=LATER)["too_old"] == 0
    assert job.done("refresh", "youtube", KB_NOW=LATER)["crawled"] == 0

    job.done("purge", "youtube", KB_NOW=LATER)
    assert job.rows(f"SELECT count(*) AS n FROM clean.youtube_rejected WHERE key = '{gone}'") == [
        {"n": 0}
    ]


def test_counts_of_fresh_metadata_are_read_again_from_a_quota_of_their_own(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    kept = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY video_id")
    changed, gone = kept[0]["video_id"], kept[1]["video_id"]
    world = job.sandbox.world.youtube.videos
    world[changed].view_count = "424242"
    world[gone].in_api = False
    words = ("refresh", "youtube", "--older-than", "7")
    plan = job.done(*words, "--plan", KB_NOW=SOON)["phases"]
    before = len(job.sandbox.ledger)
    summary = job.done(*words, KB_NOW=SOON)
    statistics = [key for keys in asked(job, COUNTS, before) for key in keys]
    in_full = {key for keys in asked(job, FULL, before) for key in keys}
    assert [phase["items"] for phase in plan] == [0, len(statistics)]
    # What the statistics leave out is asked for in full, and nothing else.
    assert in_full == {key for key in statistics if not world[key].in_api}
    assert gone in in_full
    assert (summary["crawled"], summary["missing"]) == (len(statistics), len(in_full))
    quota = job.done("status", KB_NOW=SOON)["sources"]["youtube"]["quota"]
    assert quota["statistics"]["spent"] == len(asked(job, COUNTS, before))
    assert quota["general"]["spent"] == len(asked(job, FULL, before))
    job.done("youtube", "filter", KB_NOW=SOON)
    columns = "view_count, fetched_at < counted_at AS counts_are_newer"
    assert job.rows(f"SELECT {columns} FROM clean.youtube_videos WHERE video_id = '{changed}'") == [
        {"view_count": 424242, "counts_are_newer": True}
    ]
    assert job.done(*words, KB_NOW=SOON)["crawled"] == 0
    # Fresh counts do not make the metadata fresh.
    assert job.done("status", KB_NOW=LATER)["too_old"] == len(kept) - 1


def test_everything_may_be_read_again_now_and_goes_on_where_it_stopped(job: Job) -> None:
    known = job.done(*CRAWL)["crawled"]
    before = len(job.sandbox.ledger)
    words = ("refresh", "youtube", "--older-than", "0")
    assert job.done("refresh", "youtube", "--older-than", "1")["crawled"] == 0

    def counted() -> list[str]:
        return [key for keys in asked(job, COUNTS, before) for key in keys]

    first = job.done(*words, "--limit", "10", code=3)["crawled"]
    assert len(counted()) == 10
    second = job.done(*words)
    everything = counted()
    assert first + second["crawled"] == len(everything)
    assert len(everything) == len(set(everything)) >= known
    assert job.done(*words)["crawled"] == len(everything)


def test_spent_general_quota_does_not_keep_statistics_from_being_read(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    world = job.sandbox.world
    some = job.rows("SELECT video_id FROM clean.youtube_videos ORDER BY 1")[0]["video_id"]
    world.youtube.videos[some].view_count = "987654"
    world.quota["general"] = 0
    gone = [key for key, video in world.youtube.videos.items() if not video.in_api]
    words = ("refresh", "youtube", "--older-than", "7")
    summary = job.done(*words, KB_NOW=SOON, code=3 if gone else 0)
    assert summary["left"] == len(gone)
    job.done("youtube", "filter", KB_NOW=SOON)
    assert job.rows(f"SELECT view_count FROM clean.youtube_videos WHERE video_id = '{some}'") == [
        {"view_count": 987654}
    ]


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


def test_wait_sleeps_through_a_burst_and_ends_whole(job: Job, hasty: None) -> None:
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
