"""Tests of `kb.verify.tables`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.verify.test_root import flipped, one, verify


def emptied(path: Path) -> None:
    path.write_bytes(b"")


FILES = {
    "raw/youtube/videos/*.zst": "raw answers",
    "raw/youtube/tombstones.parquet": "tombstones",
    "state/youtube.sqlite": "state",
    "clean/youtube/videos/*.parquet": "clean",
    "clean/youtube/rejected/*.parquet": "clean",
    "clean/youtube/_manifest.json": "clean",
    "pairs/pairs-*.parquet": "pairs",
    "release/youtube/videos-*.parquet": "release",
}


@pytest.mark.parametrize("pattern", FILES)
@pytest.mark.parametrize("damage", [emptied, flipped])
def test_damage_is_found_wherever_it_is(
    root: Path, pattern: str, damage: Callable[[Path], None]
) -> None:
    path = one(root, pattern)
    if path.suffix == ".json":
        path.write_bytes(path.read_bytes()[:-9])
    elif path.suffix == ".sqlite" and damage is flipped:
        path.write_bytes(path.read_bytes()[:4096] + bytes(8192))
    else:
        damage(path)
    look = verify(root)
    assert [(each.kind, each.state, each.path) for each in look.entries] == [
        (FILES[pattern], "damaged", path)
    ]
    assert look.entries[0].advice
