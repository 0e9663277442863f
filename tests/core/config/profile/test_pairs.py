"""Tests of `kb.core.config.profile.pairs`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[26]",
            "[26]\n[pairs]\ninclude = ['x']\nmin_tokens = 70\nmax_tokens = 60",
            ["'pairs': min_tokens is above max_tokens"],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
