"""Small data: what a user waits for who brings 30 videos and a thread, or looks at the demo.

    make bench ARGS="-k small"
    KB_BENCH_CODE=../older make bench ARGS="-k small"    beside another checkout's code, in one run
    KB_BENCH_DEMO=data/demo …                            also the first commands on that data root

CPU seconds are those of the process and its children beyond `python -c pass`; the least of five for
commands that only read. Explore's figure is wall time, from its start to its first page. The code
is compiled before, as it is where it was installed or has run once.
"""

import compileall
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tests.bench.measured import Measured, run
from tests.conftest import ROOT
from tests.docs.test_own_files import BLOCKS, files_of_a_player
from tests.installed import outside

pytestmark = pytest.mark.bench

VIDEOS = 30
REPEATS = 5
CHESS = "data/chess"
CODES = [ROOT, *map(Path, filter(None, [os.environ.get("KB_BENCH_CODE")]))]
DEMO = os.environ.get("KB_BENCH_DEMO")


def kb(code: Path, place: Path, *words: str, data: str = CHESS) -> Measured:
    """One command by the code of a checkout."""
    profile = {"KB_PROFILE": "chess/profile.toml"} if data == CHESS else {}
    env = {**outside(), "PYTHONPATH": str(code), "KB_DATA": data, **profile}
    done = run([sys.executable, "-m", "kb", *words], env, place)
    assert done.code == 0, done.said
    return done


def least(code: Path, place: Path, *words: str, data: str = CHESS) -> float:
    """CPU seconds of a command beyond those of Python's start, the least of some runs."""
    bare = min(run([sys.executable, "-c", "pass"], outside(), place).cpu for _ in range(REPEATS))
    return min(kb(code, place, *words, data=data).cpu for _ in range(REPEATS)) - bare


def first_page(code: Path, place: Path, data: str) -> float:
    """Seconds from the start of explore to its page."""
    env = {**outside(), "PYTHONPATH": str(code)}
    begin = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-m", "kb", "explore", "--data", data, "--port", "0", "--no-browser"],
        env=env,
        cwd=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        address = next(
            found[0] for line in process.stdout or () if (found := re.search(r"http://\S+", line))
        )
        with urllib.request.urlopen(address) as page:
            page.read()
        seconds = time.perf_counter() - begin
        process.terminate()
    return seconds


@pytest.fixture(scope="module", params=CODES, ids=lambda code: code.resolve().parent.name)
def code(request: pytest.FixtureRequest) -> Path:
    """A checkout."""
    checkout: Path = request.param.resolve()
    for folder in ("kb", "pipelines"):
        assert compileall.compile_dir(checkout / folder, quiet=1)
    return checkout


def test_small(code: Path, tmp_path: Path) -> None:
    files_of_a_player(tmp_path, VIDEOS)
    profile = next(block for block in BLOCKS if "kb profile new" in block)
    (tmp_path / "chess").mkdir()
    for name, text in re.findall(r"cat > (\S+) <<'END'\n(.*?)END\n", profile, re.DOTALL):
        (tmp_path / name).write_text(text)
    words = re.search(r"printf '(.*?)' > (\S+)", profile)
    assert words is not None
    (tmp_path / words[2]).write_text(words[1].encode().decode("unicode_escape"))
    print(f"\n{code}\n\n| {VIDEOS} videos | CPU s | wall s |\n|---|---|---|")
    for name, command in (
        ("import", ("youtube", "import", "videos")),
        ("import of a dump", ("reddit", "import", "dumps/chess.jsonl")),
        ("build", ("build",)),
    ):
        done = kb(code, tmp_path, *command)
        print(f"| {name} | {done.cpu:.1f} | {done.wall:.1f} |")
    path = tmp_path / "chess" / "profile.toml"
    path.write_text(path.read_text().replace("min_views = 0", "min_views = 1"))
    for name in ("build after a threshold", "build with nothing to do"):
        done = kb(code, tmp_path, "build")
        print(f"| {name} | {done.cpu:.1f} | {done.wall:.1f} |")
    roots = {"30 videos": CHESS}
    if DEMO:
        shutil.copytree(DEMO, tmp_path / "demo", symlinks=True)
        roots["demo"] = "demo"
    print("\n| command | data | CPU s beyond Python's start |\n|---|---|---|")
    print(f"| kb --help | | {least(code, tmp_path, '--help'):.2f} |")
    for name, data in roots.items():
        for command in (("status",), ("query", "SELECT 1"), ("search", "sicilian")):
            seconds = least(code, tmp_path, *command, data=data)
            print(f"| kb {' '.join(command)} | {name} | {seconds:.2f} |")
        print(f"| first page of explore, wall | {name} | {first_page(code, tmp_path, data):.2f} |")
