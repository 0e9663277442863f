"""Tests of `kb.core.config.profile.wiki`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[youtube]",
            '[wiki]\nurl = "https://a.b"\nmarkup.item = "Icon of .+"\n[youtube]',
            ["'wiki.markup.item' is \"Icon of ", "must have one group"],
        ),
        (
            "[youtube]",
            '[wiki]\nurl = "https://a.b"\nmarkup.item = "(."\n[youtube]',
            ["'wiki.markup.item' ", "is no regular expression"],
        ),
        (
            "[26]",
            '[26]\n[wiki]\nurl = "garden.wiki"',
            ["must be an address like https://minecraft.wiki"],
        ),
        (
            "[26]",
            '[26]\n[wiki]\nurl = "http://garden.wiki"',
            ["must begin with https://; plain http is for services on this machine alone"],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\nwiki = "garden.wiki"',
            ["'wiki' is \"garden.wiki\": must be a table"],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
