"""Rows of recorded answers."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.reddit.cassettes import Row, rows_of


@pytest.fixture
def rows(recorded: Path) -> Callable[[str], list[Row]]:
    """Rows of all answers of a cassette."""
    return lambda name: rows_of(recorded / "reddit" / f"{name}.json")
