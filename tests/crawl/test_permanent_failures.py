"""Twenty items that always fail among many, with each source's real client: all others are
read in one run, and the twenty are counted. (The feed of test_loop.py has the same in every order.)
"""

from pathlib import Path

import pytest

from kb.net import retry
from kb.sandbox.reddit.subreddit import Subreddit
from kb.sandbox.world import World
from kb.sandbox.youtube.cases import Track
from tests.faults import Sandbox
from tests.reddit.work import NOW, Work
from tests.youtube.job import Job

ALL, BAD = 200, 20


def test_captions_that_are_always_empty(tmp_path: Path) -> None:
    with Sandbox(World(n_channels=9, n_videos=120), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path)
        job.profile(("min_views = 100\n", "min_views = 100\nmax_tries = 1\n"))
        videos = sandbox.world.youtube.videos.values()
        plain = [one for one in videos if one.case.stage is None and one.tracks == [Track("en")]]
        bad = [video.id for video in plain[:BAD]]
        assert len(bad) == BAD
        fault = f"/timedtext.*v=({'|'.join(bad)})"
        sandbox.faults.add(fault, times=None, status=200, body=b"", method="GET")
        summary = job.done("youtube", "crawl")
        assert (summary["failed"], summary["left"]) == (BAD, 0)
        job.done("youtube", "filter", code=0)
        read = {row["video_id"] for row in job.rows("SELECT video_id FROM clean.youtube_videos")}
        assert {video.id for video in plain[BAD:]} <= read


def test_threads_that_are_always_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", NOW)
    monkeypatch.setattr(retry, "FIRST_S", 0.001)
    world = World()
    world.reddit = Subreddit(0, ALL, width=40, depth=6)
    world.reddit.room = 10**9
    with Sandbox(world, services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path, listings=("new",), search=())
        bad = list(world.reddit.posts)[:BAD]
        fault = rf"/comments/({'|'.join(bad)})\b"
        sandbox.faults.add(fault, times=None, status=500, body="no thread today")
        summary = work.crawl()
        assert (summary["failed"], summary["left"]) == (BAD, 0)
        answered = [seen for seen in sandbox.ledger.requests("/comments/") if seen.status == 200]
        threads = {key for seen in answered for key in world.reddit.posts if key in seen.path}
        assert threads == set(world.reddit.posts) - set(bad)
