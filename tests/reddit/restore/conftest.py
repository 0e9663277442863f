"""A second data root, for what somebody else has released."""

from pathlib import Path

import pytest

from tests.reddit.work import Work


@pytest.fixture
def far(whole: Work, tmp_path: Path) -> Work:
    """Another machine: an empty data root, the same subreddit and the released tables."""
    return Work(whole.sandbox, tmp_path)
