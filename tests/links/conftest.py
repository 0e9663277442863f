"""Fixtures of this folder."""

from pathlib import Path

import pytest

from kb.core.context import Run
from tests.links import made


@pytest.fixture
def run(tmp_path: Path) -> Run:
    root = tmp_path / "data"
    videos = [
        (f"Creeper {n}", "a wolf", [(0, "oak log"), (n + 1, "the wolf and the dragon")])
        for n in range(6)
    ]
    pages = [("Creeper", ["a creeper near an oak"]), ("Canidae", ["hound", "bed", "wolf"])]
    posts = [("Wolf", "chest wolf", ["dragon", "oak"]), ("Nothing", "here", [])]
    made.fill(root, videos, pages, posts, ["creeper", "irongolem", "creepers and creepers"])
    return made.run_at(root)
