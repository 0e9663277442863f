"""The wheel as a user has it: built once, installed outside of the checkout, its demo run once.

Test processes share one of each (the files are made under a lock), as building and the demo take
their time.
"""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from tests import trap
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
    """An environment in which nothing leads the installed program back to this checkout."""
    return {name: value for name, value in clean_environment().items() if name != "PYTHONPATH"}


# What a user's own settings may be, and what the demo must leave alone: two credentials, hosts and
# a model that are not there.
OWN_DOTENV = """\
YOUTUBE_API_KEY=a-real-key
KB_YOUTUBE_ENDPOINT=https://192.0.2.1
KB_WIKI_URL=https://192.0.2.1
"""
OWN_ENVIRONMENT = {
    "REDDIT_CLIENT_SECRET": "a-real-secret",
    "KB_REDDIT_ENDPOINT": "http://192.0.2.1",
    "KB_TOXICITY_MODEL": "/nowhere",
}


WATCHED = """\
"$BIN/kb" demo --json > demo.out
cp -r data/demo demo.again
unset KB_REDDIT_ENDPOINT
model="from kb.sandbox.toxicity import tiny_checkpoint; print(tiny_checkpoint())"
export KB_DATA=demo.again KB_TOXICITY_MODEL="$("$BIN/python" -c "$model")"
"$BIN/kb" reddit filter --workers 2 --json
"""


@pytest.fixture(scope="session")
def demo(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the installed `kb demo` was run: its data/demo, and what it printed in
    demo.out and demo.err.

    The user's own settings, in .env and in the environment, are such as no demo could be done with.
    Every address but loopback is a trap: what any process tried is in demo.attempts. As so small a
    demo starts no workers, a filter of a copy is done by two.
    """

    def run(folder: Path) -> None:
        (folder / ".env").write_text(OWN_DOTENV)
        (folder / "demo.sh").write_text(WATCHED)
        home = folder / ".home"
        home.mkdir()
        with (folder / "demo.err").open("w") as err:
            code = trap.run(
                ["bash", "-e", "demo.sh"],
                folder / "demo.attempts",
                outside() | OWN_ENVIRONMENT | {"HOME": str(home), "BIN": str(installed)},
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=err,
            )
        assert code == 0, (folder / "demo.err").read_text()[-3000:]

    return once(tmp_path_factory, "demo", run)
