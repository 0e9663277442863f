"""A released root made once, for tests that only read it."""

import shutil
from pathlib import Path

import pytest
import requests

from kb.core.config.profile import load_profile
from kb.core.config.settings import load_settings
from kb.core.context import Run
from kb.core.sources import BY_DEFAULT
from kb.release.publish.publish import publish
from kb.schema import tables
from tests.faults import Sandbox
from tests.once import once
from tests.recipes import release
from tests.release.made import build, rows
from tests.release.signed import signed
from tests.services.zenodo import TOKEN

SOURCES = BY_DEFAULT
TABLES = [
    name for name, declared in tables().items() if declared.released and declared.source in SOURCES
]
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
def released(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data root of a whole release; tests must not change it."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("KB_NOW", "2026-11-10T00:00:00Z")
            release(a_run(build(folder / "root", sources=BY_DEFAULT)))

    return once(tmp_path_factory, "released", make) / "root"


@pytest.fixture(scope="session")
def downloaded(released: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The records, fetched by the addresses that the service gives."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch, Sandbox(services=["zenodo"]) as service:
            patch.setenv("KB_NOW", "2026-11-10T00:00:00Z")
            root = Path(shutil.copytree(released, folder / "root"))
            url = service.servers["zenodo"].url
            run = a_run(root, kb_zenodo_endpoint=url, zenodo_token=TOKEN)
            for source, shown in publish(run, "zenodo", publish=True)["sources"].items():
                record = requests.get(f"{url}/api/records/{shown['id']}", timeout=10).json()
                (folder / "records" / source).mkdir(parents=True)
                for file in record["files"]:
                    (folder / "records" / source / file["key"]).write_bytes(
                        requests.get(file["links"]["self"], timeout=10).content
                    )

    return once(tmp_path_factory, "downloaded", make) / "records"


@pytest.fixture(scope="session")
def expected() -> dict[str, int]:
    return {name: len(made) for name, made in rows().items()}
