"""Fixtures of this folder."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults import Sandbox


@pytest.fixture
def service() -> Iterator[Sandbox]:
    with Sandbox(services=["zenodo"]) as sandbox:
        yield sandbox


@pytest.fixture
def root(released: Path, tmp_path: Path) -> Path:
    """A release of its own, so that a test may change it."""
    return Path(shutil.copytree(released, tmp_path / "data"))


@pytest.fixture
def hub() -> Iterator[Sandbox]:
    with Sandbox(services=["hub"]) as sandbox:
        yield sandbox
