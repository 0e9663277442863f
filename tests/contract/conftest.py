"""The demo of the shipped profile that is no game, played once: everything but the figures and what
adds to a crawl of Reddit.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kb.cli.commands.demo import play
from kb.cli.framework.options import Options
from tests.cli.conftest import clean_environment
from tests.small_worlds import DEMO

NOW = "2026-11-20T12:00:00Z"


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
        steps = play(options, without, **DEMO)
        for name in set(os.environ) - before:
            os.environ.pop(name)  # what `patch` removes, it would bring back
    return Demo(place / "demo", steps)


@pytest.fixture(scope="session")
def cooking(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    return played(
        tmp_path_factory.mktemp("cooking"), "cooking", ("reddit import", "refresh reddit", "report")
    )
