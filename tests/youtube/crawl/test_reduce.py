"""Tests of `kb.youtube.crawl.reduce`."""

from kb.store.state.frontier import Frontier
from kb.youtube.crawl.reduce import SEARCHES, UPLOADS, VIDEOS
from tests.youtube.crawl.test_fetch import CRAWL, finish
from tests.youtube.job import Job


def test_what_an_earlier_version_dropped_is_asked_for(job: Job) -> None:
    job.stopped(*CRAWL, "--only", "channels", "--limit", "1", code=3)
    frontier = Frontier(job.root / "state" / "youtube.sqlite")
    frontier.add(VIDEOS, list(job.sandbox.world.youtube.videos)[:1])
    lost = {
        kind: [next(iter(frontier.items(kind, "todo")))[0]] for kind in (SEARCHES, UPLOADS, VIDEOS)
    }
    for kind, keys in lost.items():
        frontier.mark(kind, keys, "skipped", "http_408")
    frontier.close()
    finish(job)
    frontier = Frontier(job.root / "state" / "youtube.sqlite", readonly=True)
    assert {kind: frontier.get(kind, key)[0] for kind, (key,) in lost.items()} == dict.fromkeys(
        lost, "done"
    )
    frontier.close()
