"""`kb pairs` killed at any moment: the same command goes on, to the same bytes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.conftest import clean_environment
from tests.pairs.made import fill, tables


def command(root: Path) -> list[str]:
    return [sys.executable, "-m", "kb", "pairs", "--data", str(root), "--workers", "1", "--quiet"]


def finish(root: Path) -> dict[str, bytes]:
    subprocess.run(command(root), cwd=root.parent, env=clean_environment(), check=True, timeout=120, capture_output=True)
    return {str(path.relative_to(root)): path.read_bytes() for folder in ("pairs", "release/pairs") for path in (root / folder).glob("*.parquet")}


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_goes_on_after_a_kill(tmp_path: Path, make_rows, number: signal.Signals) -> None:
    made = tables(200, 300, ["creeper", "oak log", "iron golem"], share=0.05)
    for name in ("whole", "cut"):
        fill(tmp_path / name, *made, make_rows, files=40)
    process = subprocess.Popen(command(tmp_path / "cut"), cwd=tmp_path, env=clean_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None and not any((tmp_path / "cut/state").glob("pairs/*/*.parquet")):
        time.sleep(0.005)
    process.send_signal(number)
    code = process.wait(60)
    assert code == (3 if number == signal.SIGTERM else -9)
    assert not (tmp_path / "cut/pairs").exists()
    done = len(list((tmp_path / "cut/state").glob("pairs/*/*.parquet")))
    assert 1 <= done < 40
    assert finish(tmp_path / "cut") == finish(tmp_path / "whole")
    assert not any((tmp_path / "cut/state/pairs").iterdir())
