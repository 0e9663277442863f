"""A small data root with everything that YouTube has, and a release of every source."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from kb.store import rawlog, tombstones
from kb.store.frontier import Frontier
from kb.store.layout import Layout
from tests.cli.conftest import kb  # noqa: F401  a fixture
from tests.crash import killed
from tests.release.conftest import released  # noqa: F401  a fixture


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw answers with their state, clean tables, pairs and releases; tests copy it."""
    root = tmp_path_factory.mktemp("verify") / "data"
    killed.make(root)
    tombstones.add(root, "youtube", [("gone", "named")])
    frontier = Frontier(Layout(root).state("youtube"))
    for kind in rawlog.kinds(root, "youtube"):
        for path in rawlog.segments(root, "youtube", kind):
            frontier.set_offset(kind, rawlog.base_name(path), path.stat().st_size)
    frontier.close()
    return root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    return Path(shutil.copytree(made, tmp_path / "data"))
