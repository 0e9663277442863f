"""A released root made once, for tests that only read it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.sources import BY_DEFAULT
from kb.release.build import release
from tests.release.made import build
from tests.release.signed import signed

SECRETS = {
    "youtube_api_key": "y-key-1234567",
    "reddit_client_id": "r-id-1234567",
    "reddit_client_secret": "r-secret-1234567",
    "zenodo_token": "z-token-1234567",
}


def a_run(root: Path, profile: str | Path | None = None, **settings: object) -> Run:
    """A run with invented secrets, so that the gate has something to look for."""
    return Run(
        load_settings(dotenv=False, **{**SECRETS, **settings}),
        load_profile(profile or signed()),
        root,
        workers=1,
    )


@pytest.fixture(autouse=True)
def november(monkeypatch: pytest.MonkeyPatch) -> None:
    """Made rows were read in early November 2026:
    not too old for the gate, whenever the tests run.
    """
    monkeypatch.setenv("KB_NOW", "2026-11-10T00:00:00Z")


@pytest.fixture(scope="session")
def released(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The data root of a whole release; tests must not change it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KB_NOW", "2026-11-10T00:00:00Z")
        root = build(tmp_path_factory.mktemp("released"), sources=BY_DEFAULT)
        release(a_run(root))
    return root
