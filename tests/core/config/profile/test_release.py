"""Tests of `kb.core.config.profile.release`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[26]",
            '[26]\n[release]\nversion = "2"',
            ['must be: version of the data: raise it for each published release, such as "1.0.0"'],
        ),
        (
            "[26]",
            "[26]\n[[release.creators]]\nname = ''",
            ["'release.creators[1].name' is \"\": must not be empty"],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
