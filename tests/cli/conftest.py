"""`kb` as a user runs it: a process of its own (tests/processes.py),
in an empty folder, without the caller's settings.
"""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from kb.net.certificates import VARIABLES
from tests import processes

Kb = Callable[..., "subprocess.CompletedProcess[str]"]


def clean_environment() -> dict[str, str]:
    """The environment without any setting of Lorecrawl, a machine's own certificates included: a
    session that reads them takes 0.05 s more.
    """
    ours = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_", "HF_TOKEN", "HF_ENDPOINT")
    others = ("SOURCE_DATE_EPOCH", *VARIABLES)
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(ours) and name not in others
    }


@pytest.fixture
def kb(tmp_path: Path) -> Kb:
    """kb("status", "--json", env={...}) -> CompletedProcess with text output."""

    def run(
        *arguments: str, env: dict[str, str] | None = None, timeout: float = 120
    ) -> subprocess.CompletedProcess[str]:
        return processes.run(
            arguments, env={**clean_environment(), **(env or {})}, cwd=tmp_path, timeout=timeout
        )

    return run
