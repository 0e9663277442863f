"""What all test processes share, as it takes long to make: the built wheel, the environment in
which it is installed outside of the checkout, and the demo.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.net.certificates import VARIABLES
from kb.sandbox.domain import domain_of
from kb.sandbox.server import Sandbox
from kb.sandbox.wiki.generated import PAGES
from kb.sandbox.world import World
from tests import inprocess
from tests.cli.conftest import clean_environment
from tests.once import once

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built wheel."""

    def build(folder: Path) -> None:
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "wheel",
                "-q",
                "-q",
                "--no-deps",
                "--no-build-isolation",
                "-w",
                folder,
                ROOT,
            ],
            check=True,
        )

    (built,) = once(tmp_path_factory, "wheel", build).glob("lorecrawl-*.whl")
    return built


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of an environment that has the wheel, and the dependencies of this one.

    The dependencies are reached through a .pth file, in which this environment's own .pth files
    (and so the editable checkout) don't count.
    """

    def install(folder: Path) -> None:
        home = folder / "venv"
        venv.create(home, with_pip=False)
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "-q",
                "-q",
                "--python",
                home / "bin" / "python",
                "install",
                "--no-deps",
                wheel,
            ],
            check=True,
        )
        (site,) = (home / "lib").glob("python*/site-packages")
        (site / "dependencies.pth").write_text(
            "\n".join({sysconfig.get_paths()["purelib"], sysconfig.get_paths()["platlib"]}) + "\n"
        )

    return once(tmp_path_factory, "installed", install) / "venv" / "bin"


def outside() -> dict[str, str]:
    """An environment in which nothing leads the installed program back to this checkout, and
    installers trust what they trust here.
    """
    trusted = {name: os.environ[name] for name in VARIABLES if name in os.environ}
    clean = clean_environment() | trusted
    return {name: value for name, value in clean.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which `kb demo` was run: its data are in data/demo."""

    def run(folder: Path) -> None:
        done = inprocess.run(["demo"], env=clean_environment(), cwd=folder)
        assert done.code == 0, done.err[-3000:]

    return once(tmp_path_factory, "demo", run)


@pytest.fixture(scope="session")
def downloads(demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds `release`, a copy of the demo's, and what was restored of it: by
    `kb restore .` typed in `release`, and in `release/restored` by a card's command.
    """

    def restore(folder: Path) -> None:
        place = folder / "release"
        shutil.copytree(demo / "data" / "demo" / "release", place)
        with Sandbox(World(n_named=PAGES, domain=domain_of(load_profile("minecraft")))) as sandbox:
            env = clean_environment() | sandbox.settings()
            done = inprocess.run(["restore", "."], env=env, cwd=place)
            assert done.code == 0, done.err[-3000:]
        shutil.copytree(folder / "release-restored", place / "restored")

    return once(tmp_path_factory, "downloads", restore)
