"""The demo of the shipped profile that is no game, played once: everything but the figures and what
adds to a crawl of Reddit.
"""

import json
import os
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kb.cli.commands.demo import play
from kb.cli.framework.options import Options
from kb.report import build
from tests.cli.conftest import clean_environment
from tests.once import once
from tests.small_worlds import DEMO
from tests.youtube.job import Job

NOW = "2026-11-20T12:00:00Z"


class Figureless(Job):
    """A job whose reports have no figures: those take most of the time of a build, and tests/report
    draws them.
    """

    def kb(self, *words: str, **env: str) -> subprocess.CompletedProcess[str]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(build, "_drawn", lambda *_: [])
            return super().kb(*words, **env)


class Demo(NamedTuple):
    """A data root, and the summary of each step that made it."""

    root: Path
    steps: dict[str, Any]


def played(place: Path, profile: str, without: tuple[str, ...]) -> Demo:
    """A demo in a small world."""
    with pytest.MonkeyPatch.context() as patch:
        for name in set(os.environ) - set(clean_environment()):
            patch.delenv(name)
        patch.setenv("KB_NOW", NOW)
        before = set(os.environ)
        options = Options(data=place, profile=profile, quiet=True, workers=1)
        steps = play(options, without, **DEMO, n_pages=14)
        for name in set(os.environ) - before:
            os.environ.pop(name)  # what `patch` removes, it would bring back
    return Demo(place / "demo", steps)


@pytest.fixture(scope="session")
def cooking(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    def make(folder: Path) -> None:
        demo = played(folder, "cooking", ("reddit import", "refresh reddit", "report"))
        (folder / "steps.json").write_text(json.dumps(demo.steps))

    folder = once(tmp_path_factory, "cooking", make)
    return Demo(folder / "demo", json.loads((folder / "steps.json").read_text()))
