"""Tests of `kb.store.process`."""

import subprocess
import sys

from kb.store import process


def test_a_running_process_is_known_by_its_mark_and_an_ended_one_too() -> None:
    assert not process.has_ended(f".file.{process.mark()}.tmp")
    program = "from kb.store import process; print(process.mark())"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert process.has_ended(f".file.{done.stdout.strip()}.tmp")
    assert not process.has_ended("no mark")
