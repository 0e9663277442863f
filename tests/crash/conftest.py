"""Scripts that fork and kill: in a process of their own, which has started no thread."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests import forked
from tests.cli.conftest import clean_environment
from tests.conftest import ROOT


@pytest.fixture(scope="session")
def script() -> Callable[..., str]:
    """script("swapped", place): what `python -m tests.crash.swapped PLACE` prints; ends with 0."""

    def run(name: str, *words: object) -> str:
        code = f"import runpy; runpy.run_module('tests.crash.{name}', run_name='__main__')"
        done = forked.program(code, *words, env=clean_environment(), cwd=ROOT)
        out, err = done.communicate(timeout=600)
        assert done.returncode == 0, out + err[-3000:]
        return out

    return run
