"""What tests share: recorded answers of the real services, and what to do when something is not installed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NoReturn

import pytest

ROOT = Path(__file__).resolve().parent.parent


def skip_or_fail(reason: str) -> NoReturn:
    """Skip with one line; under CI=true a missing thing is a failure, so that nothing goes untested unseen."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def recorded() -> Path:
    """The folder of recorded service answers, read in place: KB_RECORDED, or ../shared/recorded."""
    folder = Path(os.environ.get("KB_RECORDED") or ROOT.parent / "shared" / "recorded")
    if not (folder / "README.md").is_file():
        skip_or_fail(f"recorded answers are not at {folder} (set KB_RECORDED)")
    return folder
