"""Fixtures of this folder."""

import shutil
from pathlib import Path

import pytest

from kb.search.build import index
from tests.filters.made import run_at
from tests.search.made import world


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = world(tmp_path_factory.mktemp("search") / "data")
    index(run_at(root))
    return root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy, the times of its files as well."""
    return Path(shutil.copytree(made, tmp_path / "data"))
