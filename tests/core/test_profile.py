"""Profiles: found by name or path; every mistake names the key, the value and what is allowed."""

from __future__ import annotations

import pytest

from kb.core.errors import ProfileError
from kb.core.profile import load_profile

GOOD = 'name = "garden"\ntitle = "Garden"\n[youtube]\nkeywords = ["roses"]\ncategory_ids = [26]\n'


def write(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("category_ids", "categoy_ids"),
            "unknown key 'youtube.categoy_ids', did you mean 'category_ids'",
        ),
        (("[youtube]", "[youtub]"), "unknown key 'youtub', did you mean 'youtube'"),
        (
            ("category_ids = [26]", 'category_ids = [26]\ntranscripts = "requird"'),
            r"'youtube.transcripts' is 'requird'.*did you mean 'required'",
        ),
        (
            ("category_ids = [26]", "category_ids = [26]\nmin_views = -1"),
            r"'youtube.min_views' is -1: input should be greater than or equal to 0",
        ),
        (('keywords = ["roses"]', "keywords = []"), r"'youtube.keywords'"),
        (
            ("category_ids = [26]", "category_ids = [26]\nmin_duration_s = inf"),
            r"'youtube.min_duration_s' is inf: .*finite",
        ),
        (
            ("category_ids = [26]", "category_ids = [26]\nmin_aspect_ratio = nan"),
            r"'youtube.min_aspect_ratio' is nan",
        ),
        (
            ("[youtube]", "[toxicity.thresholds]\nyoutube = -inf\n[youtube]"),
            r"'toxicity.thresholds.youtube' is -inf",
        ),
        (('keywords = ["roses"]\n', ""), "'youtube.keywords' is missing"),
        (('title = "Garden"', "title = "), "not valid TOML"),
    ],
)
def test_mistakes_are_named(tmp_path, change, message):
    with pytest.raises(ProfileError, match=message):
        load_profile(write(tmp_path, GOOD.replace(*change)))


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ProfileError) as error:
        load_profile("minecarft")
    assert "minecraft" in error.value.hint


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ProfileError, match="can't be read"):
        load_profile(tmp_path / "none.toml")
