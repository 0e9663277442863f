"""`make setup`, with stand-ins for Python, pip and apt that write down what they were asked."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.wheel

ROOT = Path(__file__).resolve().parents[2]

# A stand-in for the interpreter, and for the one in .venv:
# knows `-m venv` and notes every `-m pip`.
PYTHON = r"""#!/usr/bin/env bash
case "$*" in
  *"-m venv"*) mkdir -p .venv/bin; cp "$0" .venv/bin/python
      printf '#!%s/.venv/bin/python\n' "$PWD" > .venv/bin/pip;;
  *"-m pip"*) echo "$*" >> calls
      case "$*" in *"$FAILING"*) echo "ERROR: no such thing"; exit 1;; esac;;
  *"import importlib.metadata"*) exit 1;;
  --version) echo Python 3.11.0;;
esac
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / ".ci", tmp_path / ".ci")
    for name in ("pyproject.toml", "Makefile"):
        shutil.copy(ROOT / name, tmp_path)
    tools = tmp_path / "tools"
    tools.mkdir()
    for name, text in {
        "python3": PYTHON,
        "chromium": "#!/bin/sh\n",
        "apt-get": '#!/bin/sh\necho apt-get "$@" >> calls\n',
        "id": "#!/bin/sh\necho ${FAKE_UID:-0}\n",
        "uname": "#!/bin/sh\necho ${FAKE_SYSTEM:-Linux}\n",
    }.items():
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)
    for name in (
        "bash",
        "sh",
        "cat",
        "cut",
        "sha256sum",
        "dirname",
        "head",
        "tail",
        "grep",
        "mkdir",
        "cp",
        "rm",
        "flock",
        "make",
        "sed",
        "env",
    ):
        found = shutil.which(name)
        assert found, name
        (tools / name).symlink_to(found)
    return tmp_path


def setup(checkout: Path, **env: str) -> tuple[list[str], subprocess.CompletedProcess[str]]:
    """What was asked of pip and apt, and how set-up ended."""
    calls = checkout / "calls"
    calls.unlink(missing_ok=True)
    done = subprocess.run(
        ["make", "setup"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        env={
            "PATH": str(checkout / "tools"),
            "HOME": os.environ.get("HOME", "/"),
            "FAILING": "nothing fails",
            **env,
        },
    )
    return (calls.read_text().splitlines() if calls.exists() else []), done


def test_first_call_installs_and_the_second_does_nothing(checkout: Path) -> None:
    calls, done = setup(checkout)
    assert done.returncode == 0, done.stderr
    assert "torch==2.13.0+cpu" in calls[0]
    assert "--require-hashes --no-deps -r .ci/requirements.lock" in calls[1]
    assert calls[2].endswith("-e .")
    assert len(calls) == 3
    calls, done = setup(checkout)
    assert (calls, done.returncode, done.stdout, done.stderr) == ([], 0, "", "")


@pytest.mark.parametrize("name", [".ci/requirements.lock", "pyproject.toml"])
def test_a_changed_lock_or_project_is_installed_again(checkout: Path, name: str) -> None:
    setup(checkout)
    with (checkout / name).open("a") as file:
        file.write("\n# changed\n")
    calls, _ = setup(checkout)
    assert len(calls) == 3


def test_an_interrupted_set_up_goes_on(checkout: Path) -> None:
    _, done = setup(checkout, FAILING="requirements.lock")
    assert done.returncode != 0
    assert "ERROR: no such thing" in done.stderr
    assert "pip failed" in done.stderr
    calls, done = setup(checkout)
    assert done.returncode == 0
    assert len(calls) == 3


def test_torch_falls_back_to_the_index_of_cpu_builds_and_then_to_any(checkout: Path) -> None:
    calls, done = setup(checkout, FAILING="+cpu")
    assert "--index-url" in calls[1]
    assert "torch==2.13.0 " in calls[1]
    assert done.returncode == 0
    shutil.rmtree(checkout / ".venv")
    calls, done = setup(checkout, FAILING="cpu")
    assert calls[2].endswith("install torch==2.13.0")
    assert done.returncode == 0


def test_torch_comes_plain_on_macos_and_from_where_one_says(checkout: Path) -> None:
    calls, _ = setup(checkout, FAKE_SYSTEM="Darwin")
    assert calls[0].endswith("install torch==2.13.0")
    calls, _ = setup(checkout, TORCH_INDEX="http://127.0.0.1:9/cu126")
    assert calls[0].endswith("--index-url http://127.0.0.1:9/cu126")


def test_root_gets_a_browser_and_others_a_line(checkout: Path) -> None:
    (checkout / "tools" / "chromium").unlink()
    calls, done = setup(checkout)
    assert "apt-get update" in calls
    assert "apt-get install -y --no-install-recommends chromium chromium-driver" in calls
    shutil.rmtree(checkout / ".venv")
    calls, done = setup(checkout, FAKE_UID="1000")
    assert not [call for call in calls if "apt-get" in call]
    assert done.returncode == 0
    assert len(re.findall("no chromium found", done.stderr)) == 1


def test_without_python_it_says_so(checkout: Path) -> None:
    (checkout / "tools" / "python3").unlink()
    _, done = setup(checkout)
    assert done.returncode != 0
    assert "Python 3.11 or newer is needed" in done.stderr


def test_the_lock_names_no_place() -> None:
    """Packages by name and version: no index, no file, no torch."""
    lines = (ROOT / ".ci" / "requirements.lock").read_text().splitlines()
    packages = [line.removesuffix(" \\") for line in lines if not line.startswith(("#", " "))]
    assert len(packages) > 100
    assert all(re.match(r"^[A-Za-z0-9._-]+==[^ ]+( ; .+)?$", line) for line in packages)
    assert not [line for line in packages if line.startswith(("torch=", "nvidia", "triton"))]
    assert not [
        line for line in lines if "://" in line or "--index" in line or "--find-links" in line
    ]


def test_every_file_of_the_lock_has_its_hash() -> None:
    text = (ROOT / ".ci" / "requirements.lock").read_text().partition("\n")[2]
    packages = text.replace(" \\\n", "").splitlines()
    assert len(packages) > 100
    assert all(re.search(r"( +--hash=sha256:[0-9a-f]{64})+$", line) for line in packages)


def test_targets_take_exit_3_for_success_and_pass_others_on(checkout: Path) -> None:
    setup(checkout)
    kb = checkout / ".venv" / "bin" / "kb"
    for code, wanted in (
        (0, 0),
        (3, 0),
        (1, 2),
        (2, 2),
    ):  # make itself ends with 2 when a target fails
        kb.write_text(f"#!/bin/sh\necho \"$@\"\necho 'kb: a line' >&2\nexit {code}\n")
        kb.chmod(0o755)
        done = subprocess.run(
            ["make", "youtube-crawl", "ARGS=--limit 5"],
            cwd=checkout,
            capture_output=True,
            text=True,
            check=False,
            env={"PATH": str(checkout / "tools")},
        )
        assert done.returncode == wanted
        assert done.stdout.splitlines()[0] == "youtube crawl --limit 5"
        assert "kb: a line" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_make_stops_kb_and_waits_for_it(checkout: Path, number: signal.Signals) -> None:
    """SIGTERM to make alone, as `kill` and job schedulers send it; SIGINT to all,
    as a terminal's Ctrl-C.
    """
    setup(checkout)
    kb = checkout / ".venv" / "bin" / "kb"
    kb.write_text(KB.format(python=sys.executable))
    kb.chmod(0o755)
    make = subprocess.Popen(
        ["make", "youtube-crawl"],
        cwd=checkout,
        text=True,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        # This suite may have been told to ignore SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
        env={"PATH": str(checkout / "tools")},
    )
    assert make.stdin is not None
    assert make.stdout is not None
    make.stdin.write("typed\n")
    make.stdin.flush()
    assert make.stdout.readline() == "ready typed\n"
    (os.kill if number == signal.SIGTERM else os.killpg)(make.pid, number)
    out, err = make.communicate(timeout=30)
    assert out == f"finished after {number.name}\n", err


# A stand-in for kb: at a signal it finishes what it has in hand.
KB = """#!{python}
import os, signal, sys, time

def stop(number, frame):
    time.sleep(0.2)
    os.write(1, f"finished after {{signal.Signals(number).name}}\\n".encode())
    os._exit(3)

signal.signal(signal.SIGTERM, stop)
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where it is ignored
    signal.signal(signal.SIGINT, stop)
os.write(1, b"ready " + sys.stdin.buffer.readline())
while True:
    signal.pause()
"""


def test_targets_work_from_another_folder_and_in_it(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    setup(checkout)
    kb = checkout / ".venv" / "bin" / "kb"
    kb.write_text('#!/bin/sh\necho "$PWD: $*"\n')
    kb.chmod(0o755)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    for words, line in (
        (["-f", f"{checkout}/Makefile", "status", "ARGS=--json"], f"{elsewhere}: status --json"),
        (["-C", str(checkout), "status"], f"{checkout}: status"),
        (["-f", f"{checkout}/Makefile"], "  make help"),
    ):
        done = subprocess.run(
            ["make", "--no-print-directory", *words],
            cwd=elsewhere,
            capture_output=True,
            text=True,
            check=False,
            env={"PATH": str(checkout / "tools")},
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(line)
    assert list(elsewhere.iterdir()) == []
