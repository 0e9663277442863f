"""A small data root with everything that YouTube has, and a release of every source."""

import shutil
from pathlib import Path

import pytest

from kb.crawl.session import open_session
from kb.store.state import tombstones
from kb.youtube.crawl.connector import YouTubeConnector
from tests.cli.conftest import kb  # noqa: F401  a fixture
from tests.filters import full_root
from tests.filters.made import run_at
from tests.release.conftest import released  # noqa: F401  a fixture


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw answers with their state, clean tables, pairs and releases; tests copy it."""
    root = tmp_path_factory.mktemp("verify") / "data"
    full_root.make(root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KB_NOW", "2026-11-20T12:00:00Z")  # the same bytes, of which tests flip one
        tombstones.add_tombstones(root, "youtube", [("gone", "named")])
    run = run_at(root)
    with open_session(run, YouTubeConnector(run), online=False):
        pass  # the state is made of the raw answers
    return root


@pytest.fixture
def root(made: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    return Path(shutil.copytree(made, tmp_path / "data"))


@pytest.fixture
def folders(released: Path, tmp_path: Path) -> Path:  # noqa: F811
    """A folder of downloaded releases."""
    return Path(shutil.copytree(released / "release", tmp_path / "down"))


def emptied(path: Path) -> None:
    """Leave a file without content."""
    path.write_bytes(b"")
