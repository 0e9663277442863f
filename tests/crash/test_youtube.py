"""SIGKILL at random moments of the YouTube job, then the same commands again: the same release,
and hardly a request more.
"""

import shutil
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.core import clock
from kb.sandbox.world import World
from kb.store import lock
from tests import processes
from tests.crash import harm
from tests.faults import Sandbox
from tests.youtube.job import Job, plain_units

pytestmark = pytest.mark.crash

KILLS = 5
WORKERS = 2


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """The job without a crash."""
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path_factory.mktemp("plain"))
        for step in ("crawl", "filter", "export"):
            job.done("youtube", step)
        yield job


def killed(job: Job, request: int, *words: str) -> bool:
    """Run `kb WORDS` and kill it when the request of that number comes;
    False when it ended before.
    """
    children: list[processes.ForkedProcess] = []
    fault = job.sandbox.faults.add("", after=request, then=lambda seen: children[0].kill())
    children.append(job.start(*words, "--workers", str(WORKERS)))
    children[0].communicate(timeout=200)
    job.sandbox.faults.remove(fault)
    return children[0].returncode == -9


def test_killed_again_and_again_it_makes_the_same_release(plain: Job, tmp_path: Path) -> None:
    requests = len(plain.sandbox.ledger)
    rng = clock.rng("moments of the crash test")
    with Sandbox(World(n_channels=9, n_videos=60), services=["youtube"]) as sandbox:
        job = Job(sandbox, tmp_path)
        moments = [rng.randrange(requests // 3) for _ in range(KILLS)]
        kills = sum(killed(job, moment, "youtube", "crawl") for moment in moments)
        assert kills >= 3
        assert job.done("youtube", "crawl")["left"] == 0
        job.done("youtube", "filter")
        job.done("youtube", "export")
        assert job.released() == plain.released()
        # Nothing was asked again but what was in flight: a call of the API, and a video in each
        # worker's hands.
        assert plain_units(sandbox) <= sandbox.ledger.units() <= plain_units(sandbox) + kills
        watched = Counter(seen.about for seen in sandbox.ledger.requests("/watch"))
        assert sum(watched.values()) - len(watched) <= kills * WORKERS
        calls = Counter(
            (seen.path, seen.query)
            for seen in sandbox.ledger.requests("/youtube/v3/(search|playlistItems)")
        )
        assert sum(calls.values()) - len(calls) <= kills


@pytest.mark.parametrize("step", ["filter", "export"])
def test_a_killed_filter_or_export_leaves_the_last_tables_or_none(
    plain: Job, tmp_path: Path, step: str
) -> None:
    """Killed at moments spread over its whole length, the next command finds what was there; done
    again, it makes the same bytes.
    """
    job = Job(plain.sandbox, tmp_path)
    shutil.copytree(plain.root, job.root)
    folder = ("clean", "youtube") if step == "filter" else ("release", "youtube")
    before = job.digests(*folder)
    words = ("youtube", step, *(("--workers", "1") if step == "filter" else ()))
    length = harm.run(words, job.env, job.place).operations
    assert job.digests(*folder) == before
    for quarter in (1, 2, 3):
        moment = length * quarter // 4
        ended = harm.run(words, job.env, job.place, harm=harm.KILL, before=moment)
        assert ended.code == -signal.SIGKILL
        with lock.writer(job.root, "youtube" if step == "filter" else "release-youtube"):
            assert job.digests(*folder) == before  # put back, if it was just being replaced
    job.done("youtube", step)
    assert job.digests(*folder) == before


def test_the_same_data_make_the_same_bytes(plain: Job, tmp_path: Path) -> None:
    """Whatever the number of workers, and from raw data that were copied."""
    job = Job(plain.sandbox, tmp_path)
    shutil.copytree(plain.root / "raw", job.root / "raw")
    job.done("youtube", "filter", "--workers", "1")
    job.done("youtube", "export")
    assert job.digests("release") == plain.digests("release")
    job.done("youtube", "filter", "--workers", "3")
    job.done("youtube", "export")
    assert job.digests("release") == plain.digests("release")
