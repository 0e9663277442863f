"""Progress: bars on a terminal, lines elsewhere, nothing with --quiet."""

import io
import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kb.cli.framework.options import Bars, choose_progress
from kb.core import clock
from kb.core.progress import LineProgress, Progress, Task
from tests.cli.conftest import clean_environment
from tests.core.test_terminal import HOSTILE, Terminal

PROGRAM = """
import sys
from kb.cli.framework.options import choose_progress
shown = choose_progress(quiet='--quiet' in sys.argv)
task = shown.task('metadata', total=40, unit='videos')
for _ in range(40):
    task.advance(1, units='4/10000', resets_in='3h 20m')
shown.say('a line in between')
task.close()
getattr(shown, 'close', lambda: None)()
print('result')
"""


# Sixty wait when the 42nd is done; ten more were found meanwhile; then Ctrl-C.
STOPPED = """
import sys, time
from kb.cli.framework.options import choose_progress
shown = choose_progress(quiet=False)
waiting = 60
try:
    with shown.task('transcripts', unit='videos', waiting=lambda: waiting) as task:
        for number in range(42):
            waiting -= 1
            task.advance(1)
            if number == 20:
                waiting += 43
                time.sleep(0.6)
        raise KeyboardInterrupt
except KeyboardInterrupt:
    getattr(shown, 'close', lambda: None)()
print('result')
"""

NAMED = """
from pathlib import Path
import kb.cli.app
from kb.cli.framework import messages
from kb.cli.framework.options import choose_progress
messages.set_options(Path('my data'), 'stardew')
shown = choose_progress(quiet=False)
with shown.task('metadata', total=1, unit='videos') as task:
    shown.say('run `kb reddit import --again` for it, or `kb demo`')
    task.advance(1)
getattr(shown, 'close', lambda: None)()
print('result')
"""

UNKNOWN = """
from kb.cli.framework.options import choose_progress
shown = choose_progress(quiet=False)
for name, error in (('listed', None), ('cut', KeyboardInterrupt)):
    try:
        with shown.task(name, unit='titles') as task:
            task.advance(7)
            if error:
                raise error
    except KeyboardInterrupt:
        pass
getattr(shown, 'close', lambda: None)()
print('result')
"""


def on_a_terminal(*arguments: str, program: str = PROGRAM) -> tuple[str, str]:
    """(stdout, what the terminal on stderr saw)."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        env={**clean_environment(), "TERM": "xterm", "COLUMNS": "120"},
        cwd=Path(__file__).parents[3],
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


def last_line(seen: str, name: str) -> str:
    """What the terminal shows of a task in the end, without colours."""
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen)
    return [line for line in re.split(r"[\r\n]+", plain) if line.startswith(name)][-1]


def in_a_pipe(program: str) -> str:
    """What stderr gets where it is no terminal."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[3],
        env=clean_environment(),
    )
    assert done.stdout == "result\n"
    return done.stderr


def test_a_stopped_bar_stays_partial_and_its_total_is_what_is_known() -> None:
    _, seen = on_a_terminal(program=STOPPED)
    assert "/?" not in seen, "that sixty wait was known from the start"
    line = last_line(seen, "transcripts")
    assert "42/103 videos" in line
    assert 9 <= line.count("━") <= 24
    assert "left" not in line, "no time left of what has ended"
    # The part that is done is drawn in another colour than the rest.
    bar = [part for part in re.split(r"[\r\n]+", seen) if "42/103" in part][-1]
    assert len(re.findall("━+", bar)) >= 2, bar
    assert "transcripts: 42/103 videos" in in_a_pipe(STOPPED)


def test_a_task_of_unknown_length_is_whole_in_the_end_but_not_when_it_was_stopped() -> None:
    _, seen = on_a_terminal(program=UNKNOWN)
    assert "7/7 titles" in last_line(seen, "listed")
    assert "7/? titles" in last_line(seen, "cut")
    lines = in_a_pipe(UNKNOWN)
    assert "listed: 7/7 titles" in lines
    assert "cut: 7/? titles" in lines


def test_rate_and_time_left_are_told_only_where_they_mean_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0
    monkeypatch.setattr(clock, "monotonic", lambda: now)
    waiting = 100
    task = Task("metadata", None, "videos", lambda: waiting, lambda task: None)
    task.advance(10)
    assert task.figures() == ["10/100 videos"], "too early to tell"
    now, waiting = 10.0, 90
    task.advance(0)
    assert task.figures() == ["10/100 videos", "1.0/s", "1m 30s left"]
    waiting = 190
    now = 11.0
    task.advance(0)
    assert task.figures() == ["10/200 videos", "54.5/min"], "more are being found"
    now = 20.0
    assert task.figures()[2] == "6m 20s left"
    waiting = 0
    task.advance(190)
    assert task.figures() == ["200/200 videos", "10.0/s"]


def test_quiet_shows_nothing() -> None:
    assert on_a_terminal("--quiet") == ("result\n", "")


def test_a_pipe_gets_lines() -> None:
    lines = in_a_pipe(PROGRAM)
    assert "metadata: 40/40 videos" in lines
    assert "units 4/10000" in lines
    assert "\x1b" not in lines


def test_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert type(choose_progress(quiet=True)) is Progress
    assert isinstance(choose_progress(quiet=False), LineProgress)


def test_a_command_that_a_line_names_is_as_it_has_to_be_typed() -> None:
    """With this call's --data and --profile, as in hints; on a terminal and elsewhere."""
    typed = "run `kb reddit import --again --data 'my data' --profile stardew` for it, or `kb demo`"
    assert typed in in_a_pipe(NAMED)
    _, seen = on_a_terminal(program=NAMED)
    assert typed in seen


@pytest.mark.parametrize("display", [lambda: LineProgress(sys.stderr, every=0.0), Bars])
def test_names_and_facts_of_a_task(
    monkeypatch: pytest.MonkeyPatch, display: Callable[[], Any]
) -> None:
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "dumb")
    shown = display()
    with shown.task(HOSTILE, 2) as task:
        task.advance(1, last=HOSTILE)
    getattr(shown, "close", lambda: None)()
    assert not set("\x07\x9b\u202e\u2028\ud800") & set(stream.getvalue())
    assert "\x1b]0;t" not in stream.getvalue()
    assert not [line for line in stream.getvalue().splitlines() if line.startswith("kb: ")]
    assert r"\x1b]0;t\x07" in stream.getvalue()
