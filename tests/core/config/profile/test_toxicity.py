"""Tests of `kb.core.config.profile.toxicity`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[youtube]",
            "[toxicity.thresholds]\nyoutube = -inf\n[youtube]",
            ["'toxicity.thresholds.youtube' is -inf"],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\ntoxicity = "of"',
            ["'toxicity' is \"of\": must be one of 'on' or 'off'"],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\ntoxicity = 5',
            ["'toxicity' is 5: must be a table"],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
