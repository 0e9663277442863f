"""Profiles: found by name or path; every mistake names the key, the value and what is allowed."""

from pathlib import Path

import pytest

from kb.core.config.profile import load_profile
from kb.core.config.profile.check import check_file
from kb.core.config.section import ERROR, is_everyday
from kb.core.errors import ProfileError


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


def test_tables_nested_without_end_are_one_line(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("x = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(ProfileError, match=r"nested too deeply|not valid TOML"):
        load_profile(path)
    (finding,) = check_file(path).findings
    assert finding.level == ERROR


@pytest.mark.parametrize(
    ("text", "expected"),
    [("bed", True), (" Beds ", True), ("glass", True), ("Netherite", False), ("bed frame", False)],
)
def test_a_single_usual_word_or_its_plural(text: str, expected: bool) -> None:
    assert is_everyday(text) is expected


GOOD = 'name = "garden"\ntitle = "Garden"\n[youtube]\nkeywords = ["roses"]\ncategory_ids = [26]\n'


def write(folder: Path, text: str) -> Path:
    """A profile's file."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refuse(folder: Path, old: str, new: str, *fragments: str) -> None:
    """Assert that the profile with `new` in place of `old` is refused with all `fragments`."""
    assert old in GOOD
    with pytest.raises(ProfileError) as error:
        load_profile(write(folder, GOOD.replace(old, new, 1)))
    message = str(error.value)
    assert [one for one in fragments if one not in message] == [], message
    assert "\n" not in message
    assert "pydantic" not in message


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "[youtube]",
            "[youtub]",
            ["unknown key 'youtub': did you mean 'youtube'"],
        ),
        (
            'title = "Garden"',
            "title = ",
            ["not valid TOML"],
        ),
        (
            'title = "Garden"',
            "title = 5",
            ["'title' is 5: "],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\nyoutub = 1',
            ["unknown key 'youtub'"],
        ),
        (
            'name = "garden"',
            'name = "My Garden"',
            ["must be: short name, used in file names and titles"],
        ),
        (
            "category_ids",
            "categoy_ids",
            ["unknown key 'youtube.categoy_ids': did you mean 'category_ids'"],
        ),
        (
            "category_ids = [26]",
            'category_ids = [26]\ntranscripts = "requird"',
            ["'youtube.transcripts' is \"requird\"", "'required' or 'optional'"],
        ),
        (
            "category_ids = [26]",
            "category_ids = [26]\nmin_views = -1",
            ["'youtube.min_views' is -1: "],
        ),
        (
            'keywords = ["roses"]',
            "keywords = []",
            ["'youtube.keywords'"],
        ),
        (
            "category_ids = [26]",
            "category_ids = [26]\nmin_duration_s = inf",
            ["'youtube.min_duration_s' is inf: ", "finite"],
        ),
        (
            "category_ids = [26]",
            "category_ids = [26]\nmin_aspect_ratio = nan",
            ["'youtube.min_aspect_ratio' is nan"],
        ),
        (
            'keywords = ["roses"]\n',
            "",
            ["'youtube.keywords' is missing"],
        ),
        (
            '["roses"]',
            '"roses"',
            ["'youtube.keywords' is \"roses\": "],
        ),
        (
            '["roses"]',
            "[7]",
            ["'youtube.keywords[1]' is 7: "],
        ),
        (
            '["roses"]',
            '["roses", ""]',
            ['\'youtube.keywords\' is ["roses", ""]: contains an empty phrase'],
        ),
        (
            '["roses"]',
            "[]",
            ["'youtube.keywords' is []: "],
        ),
        (
            "[26]",
            "26",
            ["'youtube.category_ids' is 26: "],
        ),
        (
            "[26]",
            '[20, "x"]',
            ["'youtube.category_ids[2]' is \"x\": "],
        ),
        (
            "[26]",
            "[26]\nmin_views = 1.5",
            ["'youtube.min_views' is 1.5: "],
        ),
        (
            "[26]",
            '[26]\nmin_views = "many"',
            ['is "many": '],
        ),
        (
            "[26]",
            '[26]\nmin_aspect_ratio = "wide"',
            ["'youtube.min_aspect_ratio' is \"wide\": "],
        ),
        (
            "[26]",
            '[26]\ntranslate = "perhaps"',
            ["'youtube.translate' is \"perhaps\": "],
        ),
        (
            "[26]",
            "[26]\nsearch_pages = 11",
            ["'youtube.search_pages' is 11: "],
        ),
        (
            "[26]",
            "[26]\ntranscripts_per_hour = 0",
            ["'youtube.transcripts_per_hour' is 0: "],
        ),
        (
            "[26]",
            '[26]\nlanguage = "English"',
            ["'youtube.language'", "'English' is no code of a language"],
        ),
        (
            "[youtube]",
            '[wiki]\nurl = "https://a.b"\nmarkup.item = "Icon of .+"\n[youtube]',
            ["'wiki.markup.item' is \"Icon of ", "must have one group"],
        ),
        (
            "[youtube]",
            '[wiki]\nurl = "https://a.b"\nmarkup.item = "(."\n[youtube]',
            ["'wiki.markup.item' ", "is not a regular expression"],
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
            ["'wiki' is \"garden.wiki\": "],
        ),
        (
            "[26]",
            '[26]\n[reddit]\nsubreddit = "r/garden"',
            ["'reddit.subreddit' is \"r/garden\": must be: name without r/"],
        ),
        (
            "[26]",
            "[26]\n[pairs]\ninclude = ['x']\nmin_tokens = 70\nmax_tokens = 60",
            ["'pairs': min_tokens is above max_tokens"],
        ),
        (
            "[26]",
            '[26]\n[release]\nversion = "2"',
            ["must be: version of the data: raise it for each published release"],
        ),
        (
            "[26]",
            "[26]\n[[release.creators]]\nname = ''",
            ["'release.creators[1].name' is \"\": "],
        ),
        (
            "[youtube]",
            "[toxicity.thresholds]\nyoutube = -inf\n[youtube]",
            ["'toxicity.thresholds.youtube' is -inf"],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\ntoxicity = "of"',
            ["'toxicity' is \"of\": "],
        ),
        (
            'title = "Garden"',
            'title = "Garden"\ntoxicity = 5',
            ["'toxicity' is 5: "],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
