"""Tests of `kb.core.progress`."""

import sys
from collections.abc import Callable
from typing import Any

import pytest

from kb.cli.framework.progress import Bars
from kb.core.progress import LineProgress
from tests.core.test_terminal import HOSTILE, Terminal


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
