"""`make setup`, with stand-ins for Python, pip and apt that write down what they were asked."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.wheel

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["custom"]
TORCH = EXTRAS["torch"]

# A stand-in for the interpreter, and for the one in .venv:
# knows `-m venv` and notes every `-m pip`.
PYTHON = r"""#!/usr/bin/env bash
version=3.11.0
case "$*" in
  *"-m venv"*) mkdir -p .venv/bin; cp "$0" .venv/bin/python; echo "venv $version" >> calls
      printf '#!%s/.venv/bin/python\n' "$PWD" > .venv/bin/pip;;
  *"-m pip"*) echo "$*" >> calls
      case "$*" in
        *"$FAILING"*) echo "ERROR: no such thing"; exit 1;;
        *"$KILLED"*) kill -9 $PPID;;
      esac;;
  *"import importlib.metadata"*) exit 1;;
  *interpreter.py) echo $version; case $version in 3.1[1-4].*) ;; *) exit 1;; esac;;
  *"import os, sys"*) echo $version;;
  --version) echo Python $version;;
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
        "python3.13": PYTHON.replace("3.11.0", "3.13.1"),
        "python3.10": PYTHON.replace("3.11.0", "3.10.13"),
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
        "awk",
        "du",
        "sleep",
    ):
        found = shutil.which(name)
        assert found, name
        (tools / name).symlink_to(found)
    return tmp_path


def setup(checkout: Path, **env: str) -> tuple[list[str], subprocess.CompletedProcess[str]]:
    """What was asked of pip, venv and apt, and how set-up ended."""
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
            "KILLED": "nobody is killed",
            **env,
        },
    )
    return (calls.read_text().splitlines() if calls.exists() else []), done


def test_first_call_installs_and_the_second_does_nothing(checkout: Path) -> None:
    calls, done = setup(checkout)
    assert done.returncode == 0, done.stderr
    assert calls[0] == "venv 3.11.0"
    assert f"torch=={TORCH}+cpu" in calls[1]
    assert "--require-hashes --no-deps -r .ci/requirements.lock" in calls[2]
    assert calls[3].endswith("-e .")
    assert len(calls) == 4
    calls, done = setup(checkout)
    assert (calls, done.returncode, done.stdout, done.stderr) == ([], 0, "", "")


def test_a_light_set_up_leaves_out_torch_and_the_browser_until_the_rest_is_asked_for(
    checkout: Path,
) -> None:
    """`.venv` remembers it: targets that need set-up do not install the rest."""
    (checkout / "tools" / "chromium").unlink()
    calls, done = setup(checkout, LIGHT="1")
    assert done.returncode == 0, done.stderr
    assert "0.7 GB" in done.stderr
    assert "make setup LIGHT=0" in done.stderr.splitlines()[-1]
    assert [call.split()[0] for call in calls] == ["venv", "-m", "-m"]
    assert "--require-hashes --no-deps --no-compile -r .venv/light.lock" in calls[1]
    lock = (checkout / ".venv" / "light.lock").read_text()
    names = set(re.findall(r"^([a-z0-9-]+)==", lock, re.MULTILINE))
    assert names == set((checkout / ".ci" / "light.txt").read_text().split())
    assert lock.count("--hash=") >= len(names)
    assert setup(checkout)[0] == []
    calls, done = setup(checkout, LIGHT="0")
    assert done.returncode == 0, done.stderr
    assert f"torch=={TORCH}+cpu" in " ".join(calls)
    assert "apt-get install -y --no-install-recommends chromium chromium-driver" in calls
    assert not any("pip" in call for call in setup(checkout)[0])


@pytest.mark.parametrize("name", [".ci/requirements.lock", "pyproject.toml"])
def test_a_changed_lock_or_project_is_installed_again(checkout: Path, name: str) -> None:
    setup(checkout)
    with (checkout / name).open("a") as file:
        file.write("\n# changed\n")
    calls, _ = setup(checkout)
    assert [call.split()[0] for call in calls] == ["-m"] * 3


def test_a_set_up_that_failed_goes_on(checkout: Path) -> None:
    _, done = setup(checkout, FAILING="requirements.lock")
    assert done.returncode != 0
    assert "ERROR: no such thing" in done.stderr
    assert "pip failed" in done.stderr
    calls, done = setup(checkout)
    assert done.returncode == 0
    assert [call.split()[0] for call in calls] == ["-m"] * 3


def test_a_set_up_that_was_killed_begins_again(checkout: Path) -> None:
    """A package may be there by half, which pip would take for whole."""
    _, done = setup(checkout, KILLED="requirements.lock")
    assert done.returncode != 0
    calls, done = setup(checkout)
    assert done.returncode == 0
    assert "making .venv again with Python 3.11.0" in done.stderr
    assert calls[0] == "venv 3.11.0"


@pytest.mark.parametrize(
    "lost", ["bin/python", "bin/pip", "lib/python3.11/site-packages/a-1.dist-info"]
)
def test_what_is_lost_comes_back(checkout: Path, lost: str) -> None:
    package = checkout / ".venv/lib/python3.11/site-packages/a-1.dist-info"
    setup(checkout)
    package.mkdir(parents=True)
    setup(checkout)
    assert setup(checkout)[0] == []
    if lost == "bin/pip":  # the environment was moved here
        (checkout / ".venv" / lost).write_text("#!/elsewhere/.venv/bin/python\n")
        (checkout / "pyproject.toml").write_text("# changed")
    elif lost == "bin/python":
        (checkout / ".venv" / lost).unlink()
    else:
        package.rmdir()
    calls, done = setup(checkout)
    assert done.returncode == 0
    assert calls[0].startswith("-m pip" if "dist-info" in lost else "venv")
    assert setup(checkout)[0] == []


def test_python_is_the_one_that_was_asked_for(checkout: Path) -> None:
    setup(checkout)
    calls, done = setup(checkout, PYTHON="python3.13")
    assert "making .venv again with Python 3.13.1" in done.stderr
    assert (calls[0], len(calls)) == ("venv 3.13.1", 4)
    assert setup(checkout, PYTHON="python3.13")[0] == []
    assert setup(checkout)[0] == [], "any Python will do where none is named"
    # As after a set-up that failed: the environment of another Python is no use.
    (checkout / ".venv" / ".ready").unlink()
    assert setup(checkout, PYTHON="python3")[0][0] == "venv 3.11.0"


@pytest.mark.parametrize("named", ["python3.10", "no-such-python"])
def test_a_python_that_cannot_run_it_is_refused_at_once(checkout: Path, named: str) -> None:
    calls, done = setup(checkout, PYTHON=named)
    assert (calls, done.returncode) == ([], 2)
    said = {"python3.10": "python3.10: 3.10.13", "no-such-python": "no-such-python: not installed"}
    assert f"no Python can run Lorecrawl ({said[named]})" in done.stderr
    assert "CPython 3.11 to 3.14" in done.stderr


def test_each_python_that_was_tried_is_named_with_its_version(checkout: Path) -> None:
    (checkout / "tools" / "python3").unlink()
    (checkout / "tools" / "python3.10").rename(checkout / "tools" / "python3")
    calls, done = setup(checkout)
    assert calls[0] == "venv 3.13.1"
    (checkout / "tools" / "python3.13").unlink()
    (checkout / ".venv" / "bin" / "python").unlink()
    calls, done = setup(checkout)
    assert (calls, done.returncode) == ([], 2)
    absent = "; ".join(f"python3.{minor}: not installed" for minor in range(11, 15))
    assert f"(python3: 3.10.13; {absent})" in done.stderr
    assert done.stderr.count("setup:") == 1


def test_torch_falls_back_to_the_index_of_cpu_builds_and_then_to_any(checkout: Path) -> None:
    calls, done = setup(checkout, FAILING="+cpu")
    assert "--index-url" in calls[2]
    assert f"torch=={TORCH} " in calls[2]
    assert done.returncode == 0
    shutil.rmtree(checkout / ".venv")
    calls, done = setup(checkout, FAILING="cpu")
    assert calls[3].endswith(f"install torch=={TORCH}")
    assert done.returncode == 0
    assert "the default build instead (3 GB to download, 6 GB on disk)" in done.stderr


def test_torch_is_left_out_where_only_a_cpu_build_is_wanted(checkout: Path) -> None:
    calls, done = setup(checkout, FAILING="cpu", TORCH_INDEX="cpu")
    assert done.returncode == 0
    assert "leaving torch out" in done.stderr
    assert [call for call in calls if call.endswith(f"install torch=={TORCH}")] == []
    calls, done = setup(checkout)
    assert f"install torch=={TORCH}+cpu" in calls[0], "as soon as it is wanted"


def test_torch_comes_plain_on_macos_and_from_where_one_says(checkout: Path) -> None:
    calls, _ = setup(checkout, FAKE_SYSTEM="Darwin")
    assert calls[1].endswith(f"install torch=={TORCH}")
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


def test_targets_take_exit_3_for_success_and_pass_others_on(checkout: Path) -> None:
    setup(checkout)
    kb = checkout / ".venv" / "bin" / "kb"
    for code, wanted in (
        (0, 0),
        (3, 0),
        (4, 2),  # somebody has to act
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
    time.sleep(0.1)
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
