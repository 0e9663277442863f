"""A purge that is killed, or comes after a killed command:
no byte of the data root keeps what is purged.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.crash


@pytest.mark.parametrize(("step", "kills"), [("purge", 12), ("filter", 6), ("pairs", 4)])
def test_nothing_is_left_of_what_was_purged(
    ends_well: Callable[..., None], tmp_path: Path, step: str, kills: int
) -> None:
    ends_well("killed", tmp_path, step, kills)
