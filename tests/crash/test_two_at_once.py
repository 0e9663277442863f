"""Two commands at once on one data root: one is paused where it writes,
the other says who holds it, and both are right.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest

from kb.core.installation import folder
from kb.core.progress import Progress, Task
from kb.export import layouts
from kb.filters.filter_run import run_clean
from kb.pairs.build import build
from kb.store.layout import Layout
from kb.store.lock import holders, writer
from kb.verify.root import verify
from tests import processes
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT
from tests.crash.chaos import leaked
from tests.filters.made import MONDAY, cues, digests, listing, put, run_at, transcript, video

pytestmark = pytest.mark.crash

PURGED = "AAAAAAAAAA1"
CONTENT = (PURGED.encode(), b"marmalade", b"quinquereme")  # of that video alone

# Filters and pairs again and again, in the data root given.
REBUILDING = """
import sys
from dataclasses import replace
from pathlib import Path
from kb.filters.filter_run import run_clean
from kb.pairs.build import build
from tests.filters.made import run_at
run = run_at(Path(sys.argv[1]))
for _ in range(4):
    run_clean(run, "youtube")
    build(replace(run, again=True))
"""

# Runs `kb`, and stops itself when it makes a folder or file of the name given first.
PAUSED = """
import os, signal, sys
wanted = [sys.argv.pop(1)]
def look(event, args):
    if wanted and event in ("os.mkdir", "open"):
        if os.path.basename(str(args[0])).startswith(wanted[0]):
            wanted.clear()
            os.kill(os.getpid(), signal.SIGSTOP)
sys.addaudithook(look)
from kb.cli import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("base") / "data"
    titles = {PURGED: "Zanzibar marmalade"}
    titles |= {f"BBBBBBBBB{number:02d}": f"Minecraft {number}" for number in range(9)}
    videos = [video(key, snippet__title=title) for key, title in titles.items()]
    put(root, "videos", (MONDAY, {"id": ",".join(titles)}, listing(*videos)))
    words = {PURGED: "quinquereme of nineveh"}
    put(
        root,
        "transcripts",
        *(
            transcript(
                key,
                cues=cues(
                    *(
                        [at * 3, 3, f"{words.get(key, 'we dig')} and a creeper comes along {at}"]
                        for at in range(12)
                    )
                ),
            )
            for key in titles
        ),
    )
    run = run_at(root)
    run_clean(run, "youtube")
    build(run)
    layouts.write_parquet(run, "youtube")
    layouts.write_parquet(run, "pairs")
    return root


@pytest.fixture
def root(base: Path, tmp_path: Path) -> Path:
    shutil.copytree(base, tmp_path / "data")
    profile = tmp_path / "profile" / "profile.toml"
    shutil.copytree(folder("profiles") / "minecraft", profile.parent)
    profile.write_text(profile.read_text().replace('toxicity = "on"', 'toxicity = "off"'))
    return tmp_path / "data"


def environment(root: Path) -> dict[str, str]:
    return clean_environment() | {"KB_PROFILE": str(root.parent / "profile" / "profile.toml")}


def start(root: Path, *words: str, pause: str) -> processes.ForkedProcess:
    """A command that stops itself when it makes what is named."""
    words = (pause, *words, "--data", str(root))
    return processes.program(PAUSED, *words, env=environment(root), cwd=root.parent)


def kb(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command, finished."""
    words = (*words, "--data", str(root))
    return processes.run(words, env=environment(root), cwd=root.parent, timeout=120)


@pytest.mark.parametrize(
    ("first", "pause", "second"),
    [
        (("pairs", "--again"), ".pairs.new", ("purge", "youtube")),
        (("youtube", "export"), ".youtube.new", ("purge", "youtube")),
        (("youtube", "export"), ".youtube.new", ("youtube", "export")),
        (("purge", "youtube"), ".youtube.new", ("pairs", "--again")),
        (("purge", "youtube"), ".youtube.new", ("youtube", "export")),
        (("youtube", "filter"), ".youtube.new", ("youtube", "export")),
    ],
)
def test_the_second_names_the_first_and_nothing_comes_back(
    root: Path, first: tuple[str, ...], pause: str, second: tuple[str, ...]
) -> None:
    ids = root.parent / "ids.txt"
    ids.write_text(f"{PURGED}\n")
    named = {"purge": ("--ids", str(ids))}
    child = start(root, *first, *named.get(first[0], ()), pause=pause)
    try:
        assert child.has_stopped(), child.communicate()
        other = kb(root, *second, *named.get(second[0], ()))
        assert other.returncode == 1, other.stderr
        assert f"another process (pid {child.pid}) writes to" in other.stderr
    finally:
        os.kill(child.pid, signal.SIGCONT)
    said = child.communicate(timeout=120)[1]
    assert child.returncode == 0, said
    assert kb(root, *second, *named.get(second[0], ())).returncode == 0
    if "purge" in (first[0], second[0]):
        assert leaked(root, CONTENT) == []
    else:
        assert digests(root / "release" / "youtube")
    assert not list(root.rglob(".*"))


def test_verify_beside_a_writer_tells_damage_and_not_what_is_on_its_way(root: Path) -> None:
    child = start(root, "youtube", "filter", pause=".youtube.new")
    try:
        assert child.has_stopped(), child.communicate()
        (root / "clean/.youtube.new/videos").mkdir(parents=True)
        (root / "clean/.youtube.new/videos/part-00000.parquet").write_bytes(b"on its way")
        whole = kb(root, "verify")
        assert whole.returncode == 0, whole.stdout
        assert f"another process (pid {child.pid}) is writing" in whole.stderr
        refused = kb(root, "verify", "--repair")
        assert refused.returncode == 1
        assert f"another process (pid {child.pid}) writes to youtube" in refused.stderr
        path = next(root.glob("clean/youtube/videos/*.parquet"))
        data = path.read_bytes()
        path.write_bytes(data[:60] + bytes([data[60] ^ 1]) + data[61:])
        told = kb(root, "verify")
        assert told.returncode == 1
        assert f"damaged: {path}" in told.stdout
        assert "leftovers" not in told.stdout
        shutil.rmtree(root / "clean/.youtube.new")
    finally:
        os.kill(child.pid, signal.SIGCONT)
    assert child.wait(timeout=120) == 0
    assert kb(root, "verify", "--repair").returncode == 0


def test_verify_while_everything_is_made_again_finds_nothing(root: Path) -> None:
    child = processes.program(REBUILDING, root, env=environment(root), cwd=ROOT)
    runs = 0
    while child.poll() is None:
        assert [(one.state, str(one.path)) for one in verify(root, Progress()).entries] == []
        runs += 1
    assert child.returncode == 0, child.output()
    assert runs > 1


def test_what_was_on_its_way_when_files_were_listed_is_not_told(root: Path) -> None:
    class Finishing(Progress):
        """The writer ends as soon as `verify` has listed the files."""

        def task(self, *args: Any, **options: Any) -> Task:
            shutil.rmtree(root / ".pairs.new", ignore_errors=True)
            held.close()
            return super().task(*args, **options)

    with contextlib.ExitStack() as held:
        held.enter_context(writer(root, "pairs"))
        (root / ".pairs.new").mkdir()
        (root / ".pairs.new/pairs-00000-of-00001.parquet").write_bytes(b"on its way")
        assert verify(root, Finishing()).entries == []


def test_a_writer_is_not_refused_for_somebody_who_looks_at_its_lock(root: Path) -> None:
    path = Layout(root).lock("pairs")
    path.write_text("1\n")  # of a process that was killed: whoever looks has to ask the kernel
    asked = threading.Event()

    def look() -> None:
        while not asked.wait(0.0005):
            holders(root)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        for _ in range(1_000):
            with writer(root, "pairs"):
                pass
            path.write_text("1\n")
    finally:
        asked.set()
        thread.join()


def test_two_repairs_at_once_are_one_and_a_line_with_its_pid(root: Path) -> None:
    path = next(root.glob("clean/youtube/videos/*.parquet"))
    path.unlink()
    child = start(root, "verify", "--repair", pause=".youtube.new")
    try:
        assert child.has_stopped(), child.communicate()
        other = kb(root, "verify", "--repair")
        assert other.returncode == 1
        assert f"another process (pid {child.pid}) writes to" in other.stderr
    finally:
        os.kill(child.pid, signal.SIGCONT)
    said = child.communicate(timeout=120)
    assert child.returncode == 0, said
    assert path.is_file()
    assert kb(root, "verify").returncode == 0
