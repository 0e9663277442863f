"""Progress: bars on a terminal, lines elsewhere, nothing with --quiet."""

from __future__ import annotations

import io
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from kb.cli import progress
from kb.core.progress import Plain, Silent
from tests.cli.conftest import clean_environment

PROGRAM = """
import sys
from kb.cli import progress
shown = progress.choose(quiet='--quiet' in sys.argv)
task = shown.task('metadata', total=40, unit='videos')
for _ in range(40):
    task.advance(1, units='4/10000', resets_in='3h 20m')
shown.say('a line in between')
task.close()
getattr(shown, 'close', lambda: None)()
print('result')
"""


def on_a_terminal(*arguments: str) -> tuple[str, str]:
    """(stdout, what the terminal on stderr saw)."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        env={**clean_environment(), "TERM": "xterm", "COLUMNS": "120"},
        cwd=Path(__file__).parents[2],
    )
    os.close(theirs)
    seen = b""
    while True:
        try:
            chunk = os.read(ours, 65536)
        except OSError:  # Linux answers EIO when the other side is closed
            break
        if not chunk:
            break
        seen += chunk
    os.close(ours)
    out, _ = process.communicate()
    assert process.returncode == 0
    return out, seen.decode()


def test_a_terminal_gets_a_bar_with_rate_and_the_stages_figures() -> None:
    out, seen = on_a_terminal()
    assert out == "result\n"
    for words in (
        "metadata",
        "40/40",
        "videos",
        "units 4/10000",
        "resets in 3h 20m",
        "a line in between",
        "━",
    ):
        assert words in seen
    assert seen.rstrip().endswith("\x1b[?25h") or "\x1b[?25h" in seen, "the cursor is shown again"


def test_quiet_shows_nothing() -> None:
    assert on_a_terminal("--quiet") == ("result\n", "")


def test_a_pipe_gets_lines() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
        env=clean_environment(),
    )
    assert done.stdout == "result\n"
    assert "metadata: 40/40 videos" in done.stderr
    assert "units 4/10000" in done.stderr
    assert "\x1b" not in done.stderr


def test_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert isinstance(progress.choose(quiet=True), Silent)
    assert isinstance(progress.choose(quiet=False), Plain)
