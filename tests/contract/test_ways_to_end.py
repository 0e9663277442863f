"""What a timer is told: for each situation the exit code, and what the same command waits for."""

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import DiskFull, NothingRead, QuotaSpent, Unreachable
from kb.core.summary import Summary
from kb.crawl.job import Parts
from kb.sandbox.world import World
from tests.conftest import ROOT
from tests.faults import Sandbox
from tests.youtube import walls
from tests.youtube.job import Job

PAGE = {"status": 403, "body": "<!doctype html><html><body>blocked</body></html>"}
LATER = {"status": 429, "headers": {"Retry-After": "7200"}}
SPENT = "quota until 2026-11-21T08:00:00Z"
PERSON = (4, "person")
# Source → the path of a fault, what is answered there; the exit code and `waits_for`.
SITUATIONS: dict[str, tuple[str, str, dict[str, Any], tuple[int, str]]] = {
    "the site's limit": ("youtube", "/watch", LATER, (3, "service until 2026-11-20T14:00:00Z")),
    "the site's captcha": ("youtube", "/watch", {"body": walls.captcha_page()}, PERSON),
    "the site's consent wall": ("youtube", "/watch", {"body": walls.consent_page()}, PERSON),
    "the API's limit": ("youtube", "/v3/videos", LATER, (3, "service until 2026-11-20T14:00:00Z")),
    "the API's page": ("youtube", "/v3/videos", PAGE, PERSON),
    "the API down": ("youtube", "/v3/playlistItems", {"status": 503}, (4, "connection")),
    "Reddit's limit": ("reddit", "^/r/", LATER, (3, "service until 2026-11-20T14:00:00Z")),
    "Reddit's page": ("reddit", "^/r/", PAGE, PERSON),
    "Reddit gone": ("reddit", "^/", {"status": None, "reset": True}, (4, "connection")),
}


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    world = World(n_channels=6, n_videos=20, n_posts=8, width=4, depth=4)
    with Sandbox(world, services=["youtube", "reddit"]) as sandbox:
        yield sandbox


@pytest.fixture
def job(sandbox: Sandbox, tmp_path: Path) -> Job:
    sandbox.faults.clear()
    job = Job(sandbox, tmp_path)
    job.profile(("[youtube]\n", "[youtube]\nmax_tries = 1\n"))
    return job


@pytest.mark.parametrize("name", SITUATIONS)
def test_a_crawl_says_whether_somebody_has_to_act(job: Job, name: str) -> None:
    source, path, what, ended = SITUATIONS[name]
    job.sandbox.faults.add(path, times=None, **{"status": 200, **what})
    summary = job.done(source, "crawl", code=ended[0])
    assert summary["waits_for"] == ended[1]
    about = job.done("status")["sources"][source]
    assert (about["stopped"], about["waits_for"]) == (summary["stopped"], summary["waits_for"])
    assert f"it waits for: {ended[1]}" in job.kb("status").stdout
    job.sandbox.faults.clear()
    job.done(source, "crawl")
    assert job.done("status")["sources"][source]["waits_for"] == ""


def test_of_several_stops_the_one_for_a_person_counts(job: Job) -> None:
    job.profile(("[youtube]\n", "[youtube]\nsearches_per_day = 1\n"))
    captcha = job.sandbox.faults.add("/watch", times=None, status=200, body=walls.captcha_page())
    assert job.done("youtube", "crawl", code=4)["waits_for"] == "person"
    job.sandbox.faults.remove(captcha)
    assert job.done("youtube", "crawl", "--limit", "1", code=3)["waits_for"] == SPENT


def test_of_several_parts_the_worst_counts_and_a_full_disk_ends_all() -> None:
    def part(error: Exception, failed: int) -> Any:
        def run() -> Summary:
            error.summary = Summary(failed=failed)  # type: ignore[attr-defined]
            raise error

        return run

    parts = Parts("restore", ())
    parts.take(part(QuotaSpent("spent"), 1))
    parts.take(part(Unreachable("gone"), 2))
    with pytest.raises(Unreachable) as ended:
        parts.finish()
    assert ended.value.summary == {"command": "restore", "requests": 0, "units": 0, "failed": 3}
    with pytest.raises(DiskFull):
        Parts("restore", ()).take(part(DiskFull("full"), 1))
    parts.take(part(NothingRead("none"), 4))
    with pytest.raises(NothingRead):
        parts.take(part(DiskFull("full"), 8))


@pytest.mark.parametrize("code", range(5))
def test_the_cron_line_of_the_document_speaks_where_somebody_has_to_act(
    tmp_path: Path, code: int
) -> None:
    page = (ROOT / "docs" / "recurring.md").read_text(encoding="utf-8")
    assert "\nSuccessExitStatus=3\n" in page
    line = page.partition("## cron\n\n```\n")[2].partition("\n```")[0]
    kb = tmp_path / "lorecrawl" / ".venv" / "bin" / "kb"
    kb.parent.mkdir(parents=True)
    kb.write_text(f"#!/bin/sh\necho a line >&2; echo the reason >&2; exit {code}\n")
    kb.chmod(0o755)
    done = subprocess.run(
        ["/bin/sh", "-c", line.split(maxsplit=5)[5]],
        env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("" if code in (0, 3) else "the reason\n", "")
