"""A folder that was on its way when its command was killed: the next command has it whole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.crash


def test_what_was_killed_between_two_renames_is_healed_by_the_next_command(
    script: Callable[..., str], tmp_path: Path
) -> None:
    script("swapped", tmp_path)
