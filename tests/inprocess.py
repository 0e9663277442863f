"""`kb` in this process: the same way from the words to the exit code, without starting Python."""

import contextlib
import io
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

import pytest

from kb.cli.app import app
from kb.cli.framework import messages
from kb.cli.framework.exit_codes import run_to_exit_code
from kb.core import clock
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


def run(words: Sequence[object], *, env: Mapping[str, str], cwd: Path) -> Done:
    """`kb WORDS`, finished, with this environment and working folder."""
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2)]
    with (
        _at(env, cwd),
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
    ):
        code = run_to_exit_code(app, [str(word) for word in words])
    return Done(code, *(one.buffer.getvalue().decode() for one in streams))


@contextlib.contextmanager
def _at(env: Mapping[str, str], cwd: Path) -> Iterator[None]:
    """What a process has to itself; nothing of it stays."""
    logger, before = logging.getLogger(), dict(os.environ)
    handlers, level = logger.handlers[:], logger.level
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(cwd)
        patch.setattr(clock, "_passed", timedelta())
        try:
            os.environ.clear()
            os.environ.update(env)
            yield
        finally:
            os.environ.clear()
            os.environ.update(before)
            logger.handlers[:] = handlers
            logger.setLevel(level)
            messages.set_options()


@pytest.fixture
def here(tmp_path: Path) -> Here:
    """here("status", "--json", env={…}): the command in an empty folder, without the caller's
    settings.
    """
    place = tmp_path / "here"
    place.mkdir()

    def typed(*words: str, env: dict[str, str] | None = None) -> Done:
        return run(words, env=clean_environment() | (env or {}), cwd=place)

    return typed
