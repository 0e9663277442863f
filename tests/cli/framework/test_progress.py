"""Progress: bars on a terminal, lines elsewhere, nothing with --quiet."""

import contextlib
import io
import os
import pty
import re
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import pytest

import kb.cli.app  # noqa: F401  commands, by which lines are completed
from kb.cli.framework import messages
from kb.cli.framework.progress_bars import Bars, choose_progress
from kb.core import clock
from kb.core.progress import LineProgress, Progress, Task
from tests.core.test_terminal import HOSTILE, Terminal

Work = Callable[[Progress], None]


def forty_videos(shown: Progress) -> None:
    task = shown.task("metadata", total=40, unit="videos")
    for _ in range(40):
        task.advance(1, units="4/10000", resets_in="3h 20m")
    shown.say("a line in between")
    task.close()


def stopped(shown: Progress) -> None:
    """Sixty wait when the 42nd is done; more were found meanwhile; then Ctrl-C."""
    waiting = 60
    with shown.task("transcripts", unit="videos", waiting=lambda: waiting) as task:
        for number in range(42):
            waiting -= 1
            task.advance(1)
            if number == 20:
                waiting += 43
        raise KeyboardInterrupt


def named(shown: Progress) -> None:
    messages.set_options(Path("my data"), "stardew")
    with shown.task("metadata", total=1, unit="videos") as task:
        shown.say("run `kb reddit import --again` for it, or `kb demo`")
        task.advance(1)
    messages.set_options()


def listed(shown: Progress) -> None:
    """Of unknown length."""
    with shown.task("listed", unit="titles") as task:
        task.advance(7)


def cut(shown: Progress) -> None:
    with shown.task("cut", unit="titles") as task:
        task.advance(7)
        raise KeyboardInterrupt


def told(work: Work, stderr: TextIO, quiet: bool = False) -> None:
    """Work that shows its progress there, and nothing on stdout."""
    out = io.StringIO()
    with (
        contextlib.redirect_stderr(stderr),
        contextlib.redirect_stdout(out),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("TERM", "xterm")
        patch.setenv("COLUMNS", "120")
        shown = choose_progress(quiet=quiet)
        with contextlib.suppress(KeyboardInterrupt):
            work(shown)
        shown.close()
    assert out.getvalue() == ""


def on_a_terminal(work: Work, quiet: bool = False) -> str:
    """What the terminal on stderr saw."""
    ours, theirs = pty.openpty()
    seen = b""

    def read() -> None:
        nonlocal seen
        with contextlib.suppress(OSError):  # Linux answers EIO when the other side is closed
            while chunk := os.read(ours, 65536):
                seen += chunk

    reader = threading.Thread(target=read)
    reader.start()
    with os.fdopen(theirs, "w") as terminal:
        told(work, terminal, quiet)
    reader.join()
    os.close(ours)
    return seen.decode()


def in_a_pipe(work: Work) -> str:
    """What stderr gets where it is no terminal."""
    told(work, stderr := io.StringIO())
    return stderr.getvalue()


def last_line(seen: str, name: str) -> str:
    """What the terminal shows of a task in the end, without colours."""
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen)
    return [line for line in re.split(r"[\r\n]+", plain) if line.startswith(name)][-1]


def test_a_terminal_gets_a_bar_with_rate_and_the_stages_figures() -> None:
    seen = on_a_terminal(forty_videos)
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


def test_a_stopped_bar_stays_partial_and_its_total_is_what_is_known() -> None:
    seen = on_a_terminal(stopped)
    assert "/?" not in seen, "that sixty wait was known from the start"
    line = last_line(seen, "transcripts")
    assert "42/103 videos" in line
    assert 9 <= line.count("━") <= 24
    assert "left" not in line, "no time left of what has ended"
    # The part that is done is drawn in another colour than the rest.
    bar = [part for part in re.split(r"[\r\n]+", seen) if "42/103" in part][-1]
    assert len(re.findall("━+", bar)) >= 2, bar
    assert "transcripts: 42/103 videos" in in_a_pipe(stopped)


def test_a_task_of_unknown_length_is_whole_in_the_end_but_not_when_it_was_stopped() -> None:
    for work, count in ((listed, "7/7 titles"), (cut, "7/? titles")):
        assert count in last_line(on_a_terminal(work), work.__name__)
        assert f"{work.__name__}: {count}" in in_a_pipe(work)


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
    assert on_a_terminal(forty_videos, quiet=True) == ""


def test_a_pipe_gets_lines() -> None:
    lines = in_a_pipe(forty_videos)
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
    assert typed in in_a_pipe(named)
    assert typed in on_a_terminal(named)


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
