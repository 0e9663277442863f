"""Tests of log lines on stderr."""

import logging
import sys

import pytest
import structlog

from kb.cli.framework import logs
from kb.cli.framework.exit_codes import report
from kb.cli.framework.messages import show_summary
from kb.core.errors import FatalError
from kb.core.progress import LineProgress
from tests.core.test_terminal import HOSTILE


def test_nothing_on_stderr_or_stdout_acts(capsys: pytest.CaptureFixture[str]) -> None:
    handlers = logging.getLogger().handlers[:]
    try:
        logs.configure(quiet=False, debug=False)
        structlog.get_logger().warning(HOSTILE, answer=HOSTILE)
        logging.getLogger("praw").warning("said %s", HOSTILE)
        report(FatalError(f"refused: {HOSTILE}"), debug=True, as_json=False)
        show_summary({"why": HOSTILE}, False)
        show_summary({"why": HOSTILE.replace("\ud800", "")}, True)
        LineProgress(sys.stderr).say(HOSTILE)
    finally:
        logging.getLogger().handlers[:] = handlers
        structlog.reset_defaults()
    done = capsys.readouterr()
    for stream in (done.out, done.err):
        assert not set("\x1b\x07\x9b\u202e\r\u2028\ud800") & set(stream)
        assert r"\x1b]0;t\x07" in stream
    lines = done.err.splitlines()
    assert [line for line in lines if line.startswith("kb: ")] == [lines[-2]]
