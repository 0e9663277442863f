"""One formatter and one linter over everything, and nothing left to fix. `make types`, which takes
minutes in a fresh clone, is a step of `.ci/run`.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import LONG

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("words", [("check",), ("format", "--check")], ids=" ".join)
def test_nothing_is_left_to_mend(words: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ruff", *words, "--no-cache", "."],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_file_in_the_order_of_long_files_exists() -> None:
    assert [name for name in LONG if not (ROOT / "tests" / name).is_file()] == []
