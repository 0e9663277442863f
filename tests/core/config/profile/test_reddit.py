"""Tests of `kb.core.config.profile.reddit`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[26]",
            '[26]\n[reddit]\nsubreddit = "r/garden"',
            ['\'reddit.subreddit\' is "r/garden": must be: name without r/, such as "Minecraft"'],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
