"""A purge that is killed, or comes after a killed command:
no byte of the data root keeps what is purged.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

pytestmark = pytest.mark.crash

KILLS = {"purge": 12, "filter": 6, "pairs": 4}


@pytest.fixture(scope="module")
def said(script: Callable[..., str], tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What killing each step has shown, a line each."""
    place = tmp_path_factory.mktemp("killed")
    return script("killed", place, *(f"{step}={n}" for step, n in KILLS.items())).splitlines()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("step", KILLS)
def test_nothing_is_left_of_what_was_purged(said: list[str], step: str) -> None:
    mine = [line for line in said if line.startswith(step)]
    assert len(mine) == 1, mine
    kills = int(mine[0].removeprefix(f"{step}: ").partition(" ")[0])
    assert mine == [f"{step}: {kills} kills, 0 bad"]
    assert kills >= KILLS[step]
