"""Each thing that can go wrong: one clear line, the right exit code, nothing written wrongly,
nothing lost.
"""

import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from kb.sandbox.youtube.service import KEY, refusal
from tests.crash import harm
from tests.faults import Sandbox
from tests.sandbox.domains import of_case
from tests.youtube import walls
from tests.youtube.job import Job, plain_units

CRAWL = ("youtube", "crawl")
QUICK = ("min_views = 100\n", "min_views = 100\nmax_tries = 2\n")


def no_patience(job: Job) -> Job:
    """Two tries a request, so that what never goes well is known soon."""
    job.profile(QUICK)
    return job


def finish(job: Job) -> None:
    """Crawl to the end: each video read, and every promising one's transcript had, whatever
    happened before.
    """
    summary = job.done(*CRAWL)
    assert (summary["failed"], summary["left"]) == (0, 0)
    check(job)


def check(job: Job) -> None:
    world = job.sandbox.world.youtube
    read = {item["id"] for envelope in job.raw("videos") for item in envelope["response"]["items"]}
    assert read == {video.id for video in world.videos.values() if video.in_api}
    had = {
        envelope["response"]["video_id"]: envelope["response"]
        for envelope in job.raw("transcripts")
    }  # the newest wins
    kept = {
        video.id: video.case.kind
        for video in world.videos.values()
        if video.case.stage in (None, "toxicity")
    }
    assert {key: had[key]["kind"] for key in kept} == kept


def test_no_key(job: Job) -> None:
    line = job.stopped(*CRAWL, code=2, YOUTUBE_API_KEY="")
    assert "YOUTUBE_API_KEY" in line
    assert len(job.sandbox.ledger) == 0
    assert not job.root.exists()


@pytest.mark.parametrize("form", ["key_invalid", "key_not_valid"])
def test_a_refused_key_ends_the_run_after_the_first_answer(job: Job, form: str) -> None:
    status, body = refusal(form)
    job.sandbox.faults.add("/youtube/v3/", status=status, body=body, times=None)
    result = job.kb(*CRAWL, "--debug", YOUTUBE_API_KEY="AIza-somebody-elses-key")
    assert result.returncode == 1
    assert "YOUTUBE_API_KEY" in result.stderr.splitlines()[-1]
    assert len(job.sandbox.ledger) == 1
    assert "somebody" not in result.stderr + result.stdout


def test_a_bucket_that_the_service_calls_spent(job: Job) -> None:
    job.sandbox.world.quota["general"] = 5
    line = job.stopped(*CRAWL, code=3)
    assert "general" in line
    assert "2026-11-21T08:00:00Z" in line  # midnight in California
    assert job.sandbox.ledger.units() == 5
    before = len(job.sandbox.ledger)
    job.stopped(*CRAWL, code=3)
    again = job.sandbox.ledger.requests("/youtube/v3/", since=before)
    assert [seen.status for seen in again] == [403]  # one request finds out whether it still is
    job.sandbox.world.quota["general"] = 10_000
    finish(job)
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)


def test_a_spent_search_bucket_does_not_keep_the_rest_from_going_on(job: Job) -> None:
    job.sandbox.world.quota["search"] = 1
    line = job.stopped(*CRAWL, code=3)
    assert "search" in line
    # The first keyword finds every channel; playlists are searched when all are.
    lists = job.sandbox.ledger.requests("/v3/playlistItems")
    assert len({seen.args["playlistId"] for seen in lists}) == len(
        job.sandbox.world.youtube.channels
    )
    job.sandbox.world.quota["search"] = 100
    finish(job)
    assert job.sandbox.ledger.units("search") == 6


def test_the_ledger_never_overruns_what_the_profile_allows_a_day(job: Job) -> None:
    job.profile(QUICK, ("max_tries = 2\n", "units_per_day = 4\nsearches_per_day = 3\n"))
    assert "quota" in job.stopped(*CRAWL, code=3)
    assert (job.sandbox.ledger.units(), job.sandbox.ledger.units("search")) == (4, 3)
    job.stopped(*CRAWL, code=3)
    assert (job.sandbox.ledger.units(), job.sandbox.ledger.units("search")) == (4, 3)
    job.stopped(*CRAWL, code=3, KB_NOW="2026-11-21T08:00:00Z")
    assert (job.sandbox.ledger.units(), job.sandbox.ledger.units("search")) == (8, 6)


def test_what_passes_is_tried_again(job: Job) -> None:
    """Bursts, 5xx, broken connections and truncated bodies, each somewhere on the way of
    one crawl.
    """
    now = {"Retry-After": "0"}
    burst, burst_429, down = (refusal(name) for name in ("burst", "burst_429", "unavailable"))
    for path, what in (
        ("/v3/search", {"status": burst[0], "body": burst[1], "headers": now}),
        ("/v3/search", {"after": 2, "cut": 0.6, "honest": True}),
        ("/v3/playlistItems", {"status": down[0], "body": down[1], "headers": now}),
        ("/v3/playlistItems", {"after": 3, "reset": True}),
        ("/v3/playlistItems", {"after": 5, "cut": 0.3}),
        ("/v3/videos", {"cut": 0.6, "honest": True}),
        ("/v3/videos", {"after": 1, "status": burst_429[0], "body": burst_429[1], "headers": now}),
        ("/watch", {"after": 1, "reset": True}),
        ("/watch", {"after": 4, "status": 503, "headers": now}),
        ("/player", {"after": 2, "cut": 0.5}),
        ("/player", {"after": 4, "cut": 0.5, "honest": True}),
        ("/timedtext", {"after": 1, "status": 429, "headers": now}),
        ("/timedtext", {"after": 3, "cut": 0.5}),
        ("/timedtext", {"after": 6, "status": 200, "body": ""}),
    ):
        job.sandbox.faults.add(path, **what)
    finish(job)


def test_an_item_that_fails_to_the_end_is_counted_and_tried_by_the_next_run(job: Job) -> None:
    no_patience(job)
    video = of_case(job.sandbox.world.youtube, "manual")[0]
    fault = job.sandbox.faults.add(f"/timedtext.*{video.id}", status=500, times=None)
    assert job.done(*CRAWL)["failed"] == 1
    summary = job.done("youtube", "filter")
    assert (summary["failed"], summary["pending"]) == (1, 0)
    assert [row["key"] for row in job.rows("FROM clean.youtube_failed")] == [video.id]
    job.sandbox.faults.remove(fault)
    before = len(job.sandbox.ledger)
    finish(job)
    assert {seen.about for seen in job.sandbox.ledger.requests(since=before)} == {video.id}


def test_the_network_is_gone_and_comes_back(job: Job) -> None:
    no_patience(job)
    job.sandbox.servers["youtube"].stop()
    summary = job.done(*CRAWL, code=4)
    assert "connection" in summary["stopped"]
    assert (summary["requests"] > 0, summary["units"]) == (True, 0)  # none reached the service
    job.sandbox.servers["youtube"].start()
    gone = job.sandbox.faults.add("/v3/videos", reset=True, times=None)
    assert "connection" in job.stopped(*CRAWL, code=4)
    job.sandbox.faults.remove(gone)
    finish(job)


def test_a_service_that_is_down_stops_the_run(job: Job) -> None:
    no_patience(job)
    job.sandbox.faults.add("/v3/playlistItems", status=503, times=None)
    job.stopped(*CRAWL, code=4)
    assert len(job.sandbox.ledger.requests("/v3/playlistItems")) < 20
    job.sandbox.faults.clear()
    finish(job)


@pytest.mark.parametrize(
    "what",
    [
        {"path": "/watch", "status": 200, "body": walls.consent_page()},
        {"path": "/player", "status": 200, "body": walls.bot_answer()},
        {"path": "/timedtext", "status": 429, "headers": {"Retry-After": "0"}},
        {
            "path": "/watch",
            "status": 302,
            "headers": {"Location": "https://consent.youtube.com/m?continue=x"},
        },
        {"path": "/watch", "status": 302, "headers": {"Location": "/sorry/index"}},
    ],
    ids=[
        "consent wall",
        "bot",
        "429",
        "sent to the consent wall",
        "sent to the captcha",
    ],
)
def test_a_block_stops_the_run_and_is_no_fact_about_a_video(job: Job, what: dict[str, Any]) -> None:
    no_patience(job)
    job.sandbox.faults.add(times=None, **what)
    code, needs = (3, "service until ") if what["status"] == 429 else (4, "person")
    assert job.done(*CRAWL, code=code)["waits_for"].startswith(needs)
    assert len(job.sandbox.ledger.requests("/watch|/player|/timedtext")) < 30  # no tight retry
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)  # the other service went on
    assert job.done("youtube", "filter")["pending"] > 0
    job.sandbox.faults.clear()
    finish(job)


def test_a_second_writer_is_told_who_the_first_is(job: Job) -> None:
    held = job.sandbox.faults.add("/v3/search", hold=True)
    first = job.start(*CRAWL)
    assert held.arrived.wait(60)
    line = job.stopped(*CRAWL, code=1)
    assert str(first.pid) in line
    held.release()
    assert first.wait(120) == 0
    first.communicate()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_finishes_the_item_in_hand(job: Job, number: int) -> None:
    held = job.sandbox.faults.add("/v3/playlistItems", after=4, hold=True)
    child = job.start(*CRAWL)
    assert held.arrived.wait(60)
    child.send_signal(number)
    held.release()
    _out, err = child.communicate(timeout=120)
    assert child.returncode == 3, err
    assert [line for line in err.splitlines() if line.startswith("kb: stopped")]
    finish(job)
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)  # nothing was asked twice
    assert len({seen.about for seen in job.sandbox.ledger.requests("/watch")}) == len(
        job.sandbox.ledger.requests("/watch")
    )


def test_the_key_is_in_no_process_list_and_no_debug_log(job: Job) -> None:
    held = job.sandbox.faults.add("/v3/videos", hold=True)
    job.sandbox.faults.add("/v3/search", reset=True)
    child = job.start(*CRAWL, "--debug")
    assert held.arrived.wait(60)
    seen = (
        subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=False).stdout
        if Path("/bin/ps").exists()
        else ""
    )
    seen += Path(f"/proc/{child.pid}/cmdline").read_text()
    job.sandbox.faults.add("/v3/videos", status=400, body=refusal("key_invalid")[1], times=None)
    held.release()
    out, err = child.communicate(timeout=120)
    assert KEY not in seen + out + err


def test_a_root_remembers_its_host(job: Job) -> None:
    job.stopped(*CRAWL, "--limit", "5", code=3)
    before = len(job.sandbox.ledger)
    url = job.sandbox.servers["youtube"].url
    line = job.stopped(*CRAWL, code=2, KB_YOUTUBE_ENDPOINT=url.replace("127.0.0.1", "localhost"))
    assert "127.0.0.1" in line
    assert len(job.sandbox.ledger) == before


def test_an_unreadable_profile(job: Job) -> None:
    path = job.profile(("min_views", "min_view"))
    line = job.stopped(*CRAWL, code=2)
    assert "min_view" in line
    assert "min_views" in line  # the guess
    path.write_text("[youtube\n")
    job.stopped(*CRAWL, code=2)
    job.stopped(*CRAWL, code=2, KB_PROFILE=str(path.parent / "absent.toml"))
    assert len(job.sandbox.ledger) == 0
    assert not job.root.exists()


@pytest.mark.parametrize("kilobytes", [4, 40])
def test_a_full_disk(job: Job, kilobytes: int) -> None:
    ended = harm.run(CRAWL, job.env, job.place, largest=kilobytes << 10)
    assert ended.code == 4, ended.err[-2000:]
    assert "Traceback" not in ended.err
    assert len([line for line in ended.err.splitlines() if line.startswith("kb: ")]) == 1
    finish(job)


def test_a_full_disk_leaves_the_last_tables_alone(job: Job) -> None:
    job.done(*CRAWL)
    job.done("youtube", "filter")
    job.done("youtube", "export")
    before = job.digests("clean"), job.digests("release")
    for words in (("youtube", "filter"), ("youtube", "export")):
        ended = harm.run(words, job.env, job.place, largest=4 << 10)
        assert ended.code == 4, ended.err[-2000:]
    assert (job.digests("clean"), job.digests("release")) == before


def test_resume_after_a_limit_asks_nothing_twice(job: Job, few: Sandbox) -> None:
    crawled = 0
    for _ in range(9):
        result = job.kb(*CRAWL, "--limit", "13")
        crawled += 1
        if result.returncode == 0:
            break
        assert result.returncode == 3
    assert crawled == 3  # 13 + 13 + 4
    asked = list(few.ledger.requests())
    assert len(asked) == len({(seen.path, seen.query, seen.about) for seen in asked})
    finish(job)
