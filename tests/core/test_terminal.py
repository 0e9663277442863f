"""Text of others is shown, never obeyed: in log lines, errors, summaries and progress."""

from __future__ import annotations

import io
import logging
import sys

import pytest
import structlog

from kb.cli import logs, outcome
from kb.core import terminal
from kb.core.errors import FatalError
from kb.core.progress import Plain

HOSTILE = "a\x1b]0;t\x07\x9b31m\u202eb\r\nkb: all is well\u2028c\ud800"


def test_one_line_writes_out_what_acts() -> None:
    shown = r"a\x1b]0;t\x07\x9b31m\u202eb\r\nkb: all is well\u2028c\ud800"
    assert terminal.one_line(HOSTILE) == shown
    assert terminal.one_line("Ünï 日本 👩‍🚀 עברית") == "Ünï 日本 👩‍🚀 עברית"
    assert terminal.lines("one\n\ttwo\x1b") == "one\n\ttwo\\x1b"


def test_nothing_on_stderr_or_stdout_acts(capsys: pytest.CaptureFixture[str]) -> None:
    handlers = logging.getLogger().handlers[:]
    try:
        logs.configure(quiet=False, debug=False)
        structlog.get_logger().warning(HOSTILE, answer=HOSTILE)
        logging.getLogger("praw").warning("said %s", HOSTILE)
        outcome.ending(FatalError(f"refused: {HOSTILE}"), debug=True, as_json=False)
        outcome.show_summary({"why": HOSTILE}, False)
        Plain(sys.stderr).say(HOSTILE)
    finally:
        logging.getLogger().handlers[:] = handlers
        structlog.reset_defaults()
    done = capsys.readouterr()
    for stream in (done.out, done.err):
        assert not set("\x1b\x07\x9b\u202e\r\u2028\ud800") & set(stream)
        assert r"\x1b]0;t\x07" in stream
    lines = done.err.splitlines()
    assert [line for line in lines if line.startswith("kb: ")] == [lines[-2]]


def test_a_progress_line_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    from kb.cli.progress import Bars

    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    Bars().say(HOSTILE)
    assert stream.getvalue() == terminal.one_line(HOSTILE) + "\n"
