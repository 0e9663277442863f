"""Profiles: found by name or path; every mistake names the key, the value and what is allowed."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.errors import ProfileError
from tests.core.config.profile.refused import GOOD, refuse, write


def test_the_shipped_profile_is_found_wherever_one_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    profile = load_profile("minecraft")
    assert (profile.youtube.min_views, profile.reddit.min_score, profile.title) == (
        100,
        5,
        "Minecraft",
    )


def test_a_profile_by_path_with_one_source(tmp_path):
    profile = load_profile(write(tmp_path, GOOD))
    assert profile.youtube.words == ("roses",)
    with pytest.raises(ProfileError, match=r"has no section \[reddit\]"):
        profile.section("reddit")


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ProfileError) as error:
        load_profile("minecarft")
    assert "minecraft" in error.value.hint


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ProfileError, match="can't be read"):
        load_profile(tmp_path / "none.toml")


def test_a_long_value_is_cut(tmp_path):
    with pytest.raises(ProfileError) as error:
        load_profile(write(tmp_path, GOOD.replace('["roses"]', '"' + "rose " * 500 + '"')))
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[youtube]",
            "[youtub]",
            ["unknown key 'youtub', did you mean 'youtube'"],
        ),
        (
            'title = "Garden"',
            "title = ",
            ["not valid TOML"],
        ),
        (
            'title = "Garden"',
            "title = 5",
            ["'title' is 5: must be text in quotes, such as \"5\""],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\nyoutub = 1',
            ["unknown key 'youtub'"],
        ),
        (
            'name = "garden"',
            'name = "My Garden"',
            ['must be: short name, used in file names and titles, such as "stardew-valley"'],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
