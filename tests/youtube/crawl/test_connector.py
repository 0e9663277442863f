"""The other ways through a crawl: a phase alone, parts of the ids, known ids, no Shorts, a new
round, a plan.
"""

import pytest

from tests.youtube.crawl.test_fetch import CRAWL, check
from tests.youtube.job import Job, plain_units


def test_the_phases_one_by_one_are_the_whole(job: Job) -> None:
    for phase in ("channels", "uploads", "metadata", "transcripts"):
        before = len(job.sandbox.ledger)
        job.done(*CRAWL, "--only", phase)
        asked = {seen.path.rsplit("/", 1)[-1] for seen in job.sandbox.ledger.requests(since=before)}
        assert (
            asked
            == {
                "channels": {"search"},
                "uploads": {"playlistItems"},
                "metadata": {"videos"},
                "transcripts": {"watch", "player", "timedtext"},
            }[phase]
        )
    check(job)
    assert job.sandbox.ledger.units() == plain_units(job.sandbox)


@pytest.mark.parametrize(
    "words",
    [
        ("--part", "3/2"),
        ("--only", "nothing"),
        ("--ids", "/no/such/file"),
        ("--ids", "/dev/null"),
        ("--ids", __file__, "--only", "channels"),
    ],
)
def test_wrong_usage_sends_and_writes_nothing(job: Job, words: tuple[str, ...]) -> None:
    job.stopped(*CRAWL, *words, code=2)
    assert len(job.sandbox.ledger) == 0
    assert not job.root.exists()
