"""`kb` in this process: the same way from the words to the exit code, without starting Python."""

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from kb.cli.app import app
from kb.cli.framework.exit_codes import run_to_exit_code
from tests.cli.conftest import clean_environment


class Done(NamedTuple):
    """How a command ended: exit code and what it printed."""

    code: int
    out: str
    err: str

    @property
    def said(self) -> str:
        """The line on stderr that says why it ended."""
        return next((line for line in self.err.splitlines() if line.startswith("kb: ")), "")


Here = Callable[..., Done]


@pytest.fixture
def here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Here:
    """here("status", "--json", env={…}): the command in an empty folder, without the caller's
    settings.
    """
    place = tmp_path / "here"
    place.mkdir()

    def run(*words: str, env: dict[str, str] | None = None) -> Done:
        logger = logging.getLogger()
        handlers, level = logger.handlers[:], logger.level
        capsys.readouterr()
        with monkeypatch.context() as patch:
            patch.chdir(place)
            for name in set(os.environ) - set(clean_environment()):
                patch.delenv(name)
            for name, value in (env or {}).items():
                patch.setenv(name, value)
            try:
                code = run_to_exit_code(app, list(words))
            finally:
                logger.handlers[:] = handlers
                logger.setLevel(level)
        return Done(code, *capsys.readouterr())

    return run
