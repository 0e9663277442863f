"""A purge that is killed, or comes after a killed command:
no byte of the data root keeps what is purged.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import clean_environment
from tests.conftest import ROOT

pytestmark = pytest.mark.crash


@pytest.mark.parametrize(("step", "kills"), [("purge", 12), ("filter", 6), ("pairs", 4)])
def test_nothing_is_left_of_what_was_purged(tmp_path: Path, step: str, kills: int) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.crash.killed", str(tmp_path), step, str(kills)],
        cwd=ROOT,
        env=clean_environment() | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
