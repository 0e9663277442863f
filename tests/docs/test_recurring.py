"""docs/recurring.md: its units, cron line and snippets, run as they stand."""

import configparser
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.sandbox.world import World
from tests.conftest import ROOT
from tests.faults import Sandbox
from tests.youtube.job import Job

TEXT = (ROOT / "docs" / "recurring.md").read_text(encoding="utf-8")
SERVICE, FAILED, _TIMER = re.findall(r"^```ini\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
DOMAINS, WATCH = re.findall(r"^```bash\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
(SCHEDULED,) = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
(CRON,) = re.findall(r"^17 4 \* \* \*  (.*)$", TEXT, re.MULTILINE)


def unit(text: str) -> configparser.ConfigParser:
    parsed = configparser.ConfigParser(interpolation=None)
    parsed.optionxform = str  # type: ignore[assignment,method-assign]
    parsed.read_string(text)
    return parsed


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Job]:
    """A home with a checkout in it, whose `kb` knows the sandbox; `mail` keeps what it is sent."""
    with Sandbox(World(n_channels=3, n_videos=9), services=["youtube"]) as sandbox:
        made = Job(sandbox, tmp_path / "lorecrawl")
        tools = made.place / ".venv" / "bin"
        tools.mkdir(parents=True)
        program(tools / "kb", f'exec "{sys.executable}" -m kb "$@"')
        program(tools / "python", f'exec "{sys.executable}" "$@"')
        program(tools / "mail", 'echo "to $3: $2" > ~/mail; cat >> ~/mail')
        made.env |= {
            "HOME": str(tmp_path),
            "USER": "operator",
            "PYTHONPATH": str(ROOT),
            "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
        }
        yield made


def program(path: Path, script: str) -> None:
    path.write_text(f"#!/bin/bash\n{script}\n")
    path.chmod(0o755)


def shell(job: Job, script: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", script],
        cwd=job.place,
        env=job.env,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )


def started(job: Job, text: str) -> int:
    """The exit code of what a unit starts, as systemd starts it."""
    service = unit(text)["Service"]
    words = [word.replace("%h", job.env["HOME"]) for word in shlex.split(service["ExecStart"])]
    name, _, value = service.get("Environment", "A=").partition("=")
    return subprocess.run(
        words,
        cwd=service["WorkingDirectory"].replace("%h", job.env["HOME"]),
        env=job.env | {name: value.replace("%h", job.env["HOME"])},
        capture_output=True,
        check=False,
    ).returncode


def test_the_unit_tells_a_person_where_one_has_to_act_and_not_after_a_quota(job: Job) -> None:
    """Then the scheduler's function and what to watch, over the same data root."""
    service = unit(SERVICE)
    assert service["Unit"]["OnFailure"] == "lorecrawl-failed.service"
    assert "# ~/.config/systemd/user/lorecrawl-failed.service" in FAILED
    fine = {"0", service["Service"]["SuccessExitStatus"]}
    job.profile(("[youtube]\n", "[youtube]\nunits_per_day = 2\n"))
    job.stopped("youtube", "crawl", code=3)
    assert str(started(job, SERVICE)) == "3"
    assert "3" in fine
    refused = job.sandbox.faults.add("/v3/", status=403, body="<html>a captcha</html>", times=None)
    job.env["KB_NOW"] = "2026-11-22T12:00:00Z"
    code = started(job, SERVICE)
    assert code in (1, 4)
    assert str(code) not in fine
    assert started(job, FAILED) == 0
    mail = (Path(job.env["HOME"]) / "mail").read_text()
    assert mail.startswith("to operator: Lorecrawl needs a person\n")
    assert f"ends with exit code {code}" in mail
    assert "left: " in mail

    names: dict[str, object] = {}
    exec(compile(SCHEDULED, "docs/recurring.md", "exec"), names)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in job.env.items():
            patch.setenv(name, value)
        patch.chdir(job.place)
        update = names["update"]
        assert callable(update)
        with pytest.raises(RuntimeError, match=r"^kb: "):
            update("data")
        job.sandbox.faults.remove(refused)
        assert "quota until " in update("data")["waits_for"]
    watched = shell(job, f"set -e\n{WATCH}")
    assert watched.returncode == 0, watched.stderr
    assert re.search(r"^last run: update \S+ exit code 3$", watched.stdout, re.MULTILINE)
    assert "'general': '2/2'" in watched.stdout


@pytest.mark.parametrize(
    ("codes", "worst"), [("0 0", 0), ("3 0", 3), ("3 4", 4), ("4 3", 4), ("1 4", 1), ("0 1", 1)]
)
def test_the_worst_of_several_domains_counts(job: Job, codes: str, worst: int) -> None:
    """As with several sources: 1, then 4, 3, 0."""
    first, second = codes.split()
    kb = job.place / ".venv" / "bin" / "kb"
    program(kb, f'echo "$*" >> asked; case "$*" in *gardening*) exit {first};; esac; exit {second}')
    assert shell(job, f"set -e\n{DOMAINS}").returncode == worst
    assert (job.place / "asked").read_text().splitlines() == [
        f"update --quiet --data data/{name} --profile {name}/profile.toml"
        for name in ("gardening", "chess")
    ]


@pytest.mark.parametrize(("code", "mailed"), [(0, ""), (3, ""), (4, "a line\n"), (1, "a line\n")])
def test_cron_mails_the_reason_where_a_person_has_to_act(job: Job, code: int, mailed: str) -> None:
    program(job.place / ".venv" / "bin" / "kb", f"echo 'a line' >&2; exit {code}")
    assert shell(job, CRON).stdout == mailed
