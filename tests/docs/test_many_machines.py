"""The scripts of docs/many-machines.md, run with stand-ins for Slurm's own commands."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.conftest import ROOT, needs
from tests.faults import Sandbox
from tests.youtube.job import Job

needs("distributed")

TEXT = (ROOT / "docs" / "many-machines.md").read_text(encoding="utf-8")
CRAWL, FILTER = re.findall(r"^```bash\n(#!.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox(World(n_channels=3, n_videos=40)) as services:
        yield services


@pytest.fixture
def job(sandbox: Sandbox, tmp_path: Path) -> Job:
    """With `kb`, `dask` and Slurm's `srun` and `scontrol` on the path."""
    made = Job(sandbox, tmp_path)
    tools = {
        "kb": f'exec "{sys.executable}" -m kb "$@"',
        "dask": f'exec "{sys.executable}" -m dask "$@"',
        "srun": 'exec "$@"',
        "scontrol": f'echo "$@" >> "{tmp_path}/requeued"',
    }
    (tmp_path / "bin").mkdir()
    for name, line in tools.items():
        path = tmp_path / "bin" / name
        path.write_text(f"#!/bin/bash\n{line}\n")
        path.chmod(0o755)
    made.env |= {
        "PATH": f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SLURM_JOB_ID": "7",
        "SLURM_ARRAY_JOB_ID": "7",
        "SLURM_ARRAY_TASK_COUNT": "2",
        "SLURM_CPUS_PER_TASK": "2",
        "KB_PARTS": str(tmp_path / "parts"),
    }
    return made


def started(job: Job, script: str, **env: str) -> subprocess.Popen[str]:
    path = job.place / "script.sh"
    path.write_text(script)
    return subprocess.Popen(
        ["bash", str(path)],
        cwd=job.place,
        env=job.env | env,
        text=True,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, err = process.communicate(timeout=200)
    return process.returncode, err


@pytest.mark.dask
def test_the_job_with_scheduler_and_workers_filters_as_one_process(job: Job) -> None:
    job.done("youtube", "crawl")
    alone = job.done("youtube", "filter")
    code, err = ended(started(job, FILTER))
    assert code == 0, err
    assert not (job.place / "requeued").exists()
    assert job.done("status")["sources"]["youtube"]["kept"] == alone["kept"]


@pytest.mark.slow
def test_the_array_job_crawls_its_parts_and_a_stopped_one_is_queued_again(job: Job) -> None:
    job.done("youtube", "crawl", "--only", "channels", KB_DATA=str(job.place / "parts" / "found"))
    before = len(job.sandbox.ledger)
    first = started(job, CRAWL, SLURM_ARRAY_TASK_ID="1")
    while len(job.sandbox.ledger) < before + 3:
        assert first.poll() is None
        time.sleep(0.01)
    first.send_signal(signal.SIGTERM)
    assert ended(first)[0] == 3
    assert (job.place / "requeued").read_text() == "requeue 7_1\n"
    for part in ("1", "2"):
        code, err = ended(started(job, CRAWL, SLURM_ARRAY_TASK_ID=part))
        assert code == 0, err
    parts = [str(job.place / "parts" / f"part-{part}") for part in ("1", "2")]
    assert job.done("merge", *parts)["files"] > 0
    assert job.done("youtube", "filter")["crawled"] > 30
