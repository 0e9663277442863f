"""Kills a command before each rename of a folder, then runs another one.

A script, so that nothing has started a thread when it forks: `python -m tests.crash.swapped PLACE`
ends with 1 and a line for each folder that did not come back.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from kb.core.pipeline import load, locate
from kb.export import parquet
from kb.filters.clean import run_clean
from kb.release.build import exported
from kb.store import lock
from tests.crash import killed
from tests.filters.made import run_at


def _export(root: Path, source: str) -> object:
    with lock.taking(root, f"release-{source}"):
        return parquet.export(run_at(root), source)


def _pairs(root: Path) -> object:
    with lock.taking(root, "pairs", "release-pairs"):
        return load(str(locate("pairs", None))).pairs(run_at(root), "parquet")


def _found(root: Path) -> object:
    """What a release begins with; the folders are both there."""
    with lock.taking(root, *lock.RELEASES):
        assert [folder.source for folder in exported(run_at(root))] == ["youtube", "pairs"]
    return None


# what is killed, what is on its way then, and what comes next
STEPS: dict[str, tuple[Callable[[Path], object], str, Callable[[Path], object]]] = {
    "filter, export": (
        lambda root: run_clean(run_at(root), "youtube"),
        "clean/youtube",
        lambda root: _export(root, "youtube"),
    ),
    "filter, pairs": (lambda root: run_clean(run_at(root), "youtube"), "clean/youtube", _pairs),
    "pairs, pairs": (killed.STEPS["pairs"], "pairs", _pairs),
    "export, release": (
        lambda root: _export(root, "youtube"),
        "release/youtube",
        _found,
    ),
}


def killed_in_swap(step: Callable[[], object], folder: Path) -> bool:
    """Run a step that dies between the two renames of a folder; whether it did."""
    child = os.fork()
    if child == 0:

        def look(event: str, args: tuple[object, ...]) -> None:
            if event == "os.rename" and str(args[1]) == str(folder):
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(look)
        step()
        os._exit(0)
    return os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL


def main(place: Path) -> int:
    """0 when every folder was healed, with the same files."""
    base, root = place / "base", place / "root"
    status, _ = killed.forked(lambda: killed.make(base))
    assert status == 0
    bad = 0
    for name, (first, folder, following) in STEPS.items():
        shutil.rmtree(root, ignore_errors=True)
        shutil.copytree(base, root)
        files = sorted(path.name for path in (root / folder).rglob("*.parquet"))
        died = killed_in_swap(lambda first=first: first(root), root / folder)  # type: ignore[misc]
        gone = not (root / folder).exists()
        status, _ = killed.forked(lambda following=following: following(root))  # type: ignore[misc]
        healed = sorted(path.name for path in (root / folder).rglob("*.parquet"))
        if not died or not gone or status or files != [n for n in healed if n in files]:
            print(f"{name}: killed {died}, gone {gone}, then {status}: {files} {healed}")
            bad += 1
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
