"""Scripts that fork and kill: in a process of their own, which has started no thread."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import pytest

from tests.cli.conftest import clean_environment
from tests.conftest import ROOT


@pytest.fixture(scope="session")
def script() -> Callable[..., str]:
    """script("swapped", place): what `python -m tests.crash.swapped PLACE` prints; ends with 0."""

    def run(name: str, *words: object) -> str:
        done = subprocess.run(
            [sys.executable, "-m", f"tests.crash.{name}", *map(str, words)],
            cwd=ROOT,
            env=clean_environment() | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr[-3000:]
        return done.stdout

    return run
