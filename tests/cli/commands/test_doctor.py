"""`kb doctor`: each thing that is missing is told with what to do, and no secret is."""

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.engine.test_dask import Own, own  # noqa: F401  a fixture
from tests.faults import Sandbox
from tests.inprocess import Here
from tests.youtube.job import Job


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=2, n_videos=10), services=["youtube", "reddit"]) as services:
        yield services


@pytest.fixture
def job(sandbox: Sandbox, tmp_path: Path) -> Job:
    return Job(sandbox, tmp_path)


def lines(job: Job, *words: str, code: int, **env: str) -> dict[str, tuple[str, str, str]]:
    """state, found, fix by what is checked."""
    told = job.done("doctor", *words, code=code, **env)
    assert told["problems"] == sum(one["state"] == "problem" for one in told["checks"])
    assert (code == 1) == (told["problems"] > 0)
    return {one["what"]: (one["state"], one["found"], one["fix"]) for one in told["checks"]}


def test_a_machine_that_has_everything_and_no_secret_in_the_lines(job: Job) -> None:
    secret = "AIzaSyD-never-to-be-seen"
    shown = job.kb("doctor", YOUTUBE_API_KEY=secret, HF_TOKEN="")
    assert shown.returncode == 0, shown.stderr
    assert secret not in shown.stdout + shown.stderr
    rows = [line.split(maxsplit=1) for line in shown.stdout.splitlines()[:-1]]
    assert {state for state, _ in rows} == {"ok", "note"}
    told = [text for _, text in rows]
    assert "YOUTUBE_API_KEY: set" in told
    assert any(one.startswith("ZENODO_TOKEN: not set") for one in told)
    assert any(one.startswith("KB_YOUTUBE_ENDPOINT: http://127.0.0.1:") for one in told)
    assert any(one.startswith("data root (yet to be made): ") for one in told)
    assert not job.root.exists()


@pytest.mark.parametrize("with_browser", [False, True])
def test_without_browser_or_driver(job: Job, with_browser: bool) -> None:
    tools = job.place / "tools"
    tools.mkdir()
    if with_browser:
        (tools / "chromium").write_text("#!/bin/sh\necho Chromium 149.0\n")
        (tools / "chromium").chmod(0o755)
    env = {"PATH": str(tools), "SE_CACHE_PATH": str(tools)}
    state, found, fix = lines(job, code=1, **env)["browser"]
    assert state == "problem"
    assert found.startswith("chromedriver" if with_browser else "Chromium and chromedriver")
    assert "install" in fix


def test_a_data_root_that_can_not_be_written(job: Job) -> None:
    state, found, fix = lines(job, "--data", "/proc/kb", code=1)["data root (yet to be made)"]
    assert state == "problem"
    assert found.startswith("/proc/kb on proc: ")
    assert "--data" in fix


def test_a_clock_that_is_behind(job: Job) -> None:
    job.done("youtube", "crawl", "--only", "channels")
    assert lines(job, code=0)["clock"][0] == "ok"
    segment = next((job.root / "raw").glob("*/*/*.zst"))
    os.utime(segment, (time.time() + 86_400,) * 2)
    state, _, fix = lines(job, code=1)["clock"]
    assert (state, fix[:7]) == ("problem", "set it:")


def test_too_little_disk_for_the_plan(
    job: Job, here: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(job.place)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage._replace(free=10**6))
    ours = {name: value for name, value in job.env.items() if name.startswith(("KB_", "YOUTUBE_"))}
    done = here("doctor", env=ours)
    assert done.code == 1
    assert "problem  disk: 1.0 MB free; crawls need about" in done.out
    # A crawl says so in one line, and begins.
    crawled = here("youtube", "crawl", "--only", "channels", env=ours)
    assert crawled.code == 0, crawled.err
    (line,) = [one for one in crawled.err.splitlines() if "the crawl needs about" in one]
    assert "1.0 MB are free" in line


def test_a_model_that_is_not_there(sandbox: Sandbox, tmp_path: Path) -> None:
    job = Job(sandbox, tmp_path, toxicity=True, KB_TOXICITY_MODEL=str(tmp_path / "none.ckpt"))
    state, found, fix = lines(job, code=1)["toxicity model"]
    assert state == "problem"
    assert "none.ckpt" in found + fix


def test_services_are_asked_only_when_wanted(job: Job) -> None:
    asked = len(job.sandbox.ledger)
    gone = {"KB_YOUTUBE_ENDPOINT": "http://127.0.0.1:1"}
    assert "service youtube" not in lines(job, code=0, **gone)
    assert len(job.sandbox.ledger) == asked
    told = lines(job, "--online", code=1, **gone)
    assert told["service youtube"][0] == "problem"
    assert told["service reddit"][0] == "ok"


@pytest.mark.dask
def test_each_worker_has_a_line(own: Own, job: Job) -> None:  # noqa: F811
    job.done("youtube", "crawl", "--only", "channels")
    own.worker()
    words = ("--engine", "dask", "--scheduler", own.address)
    for _ in range(100):
        told = job.kb("doctor", *words, "--json")
        if "worker tcp://" in told.stdout:
            break
    assert told.returncode == 0, told.stdout
    assert "1 threads, as here" in told.stdout
