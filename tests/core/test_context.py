"""Tests of `kb.core.context`."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import Settings
from kb.core.context import Run


@pytest.mark.parametrize(
    ("about", "size", "expected"),
    [
        ({"asked": False}, 1_000, 1),  # a few bytes are read by the time that a process starts
        ({"asked": False}, 1 << 30, 4),
        ({"asked": True}, 1_000, 4),
        ({"asked": False, "engine": "dask"}, 1_000, 4),  # a cluster's processes run already
    ],
)
def test_processes_are_started_where_they_pay(about: dict, size: int, expected: int) -> None:
    run = Run(Settings(), load_profile("minecraft"), Path("data"), workers=4, **about)
    assert run.processes(size) == expected
