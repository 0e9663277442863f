"""`kb` as a user runs it: a process of its own,
in an empty folder, without the caller's settings.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Kb = Callable[..., "subprocess.CompletedProcess[str]"]


def clean_environment() -> dict[str, str]:
    """The environment without any setting of Lorebase."""
    ours = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_")
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(ours) and name != "SOURCE_DATE_EPOCH"
    }


@pytest.fixture
def kb(tmp_path: Path) -> Kb:
    """kb("status", "--json", env={...}) -> CompletedProcess with text output."""

    def run(
        *arguments: str, env: dict[str, str] | None = None, timeout: float = 120
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "kb", *arguments],
            cwd=tmp_path,
            env={**clean_environment(), **(env or {})},
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
            check=False,
        )

    return run
