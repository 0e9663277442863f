"""Tests of `kb demo`."""

import os
from pathlib import Path

import pytest

from kb.cli.commands import demo
from kb.cli.commands.demo import play
from kb.cli.framework.options import Options
from tests.small_worlds import DEMO


@pytest.mark.parametrize(("asked", "workers"), [(None, 1), (3, 3)])
def test_a_demo_is_done_by_one_process_unless_more_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: int | None, workers: int
) -> None:
    """Its world is done before others have imported what they need."""
    seen: list[int] = []
    monkeypatch.setattr(demo, "_all", lambda steps, queries, run, *rest: seen.append(run.workers))
    monkeypatch.setattr(demo, "_model", lambda options: {})
    before = dict(os.environ)
    try:
        play(Options(data=tmp_path, quiet=True, workers=asked), **DEMO)
    finally:
        os.environ.clear()
        os.environ.update(before)
    assert seen == [workers]
