"""Profiles: found by name or path; every mistake names the key, the value and what is allowed."""

import pytest

from kb.core.config.profile import load_profile
from kb.core.errors import ProfileError

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
            r"""'youtube.transcripts' is "requird".*did you mean 'required'""",
        ),
        (
            ("category_ids = [26]", "category_ids = [26]\nmin_views = -1"),
            r"'youtube.min_views' is -1: must be at least 0",
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
        (
            ("[youtube]", '[wiki]\nurl = "https://a.b"\nmarkup.item = "Icon of .+"\n[youtube]'),
            "'wiki.markup.item' is \"Icon of .*must have one group",
        ),
        (
            ("[youtube]", '[wiki]\nurl = "https://a.b"\nmarkup.item = "(."\n[youtube]'),
            "'wiki.markup.item' .*is no regular expression",
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


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '["roses"]',
            '"roses"',
            """'youtube.keywords' is "roses": must be a list in brackets, such as ["roses"]""",
        ),
        (
            '["roses"]',
            "[7]",
            """'youtube.keywords[1]' is 7: must be text in quotes, such as "7\"""",
        ),
        (
            '["roses"]',
            '["roses", ""]',
            """'youtube.keywords' is ["roses", ""]: holds an empty keyword""",
        ),
        ('["roses"]', "[]", "'youtube.keywords' is []: must hold at least 1"),
        ("[26]", "26", "'youtube.category_ids' is 26: must be a list in brackets, such as [26]"),
        (
            "[26]",
            '[20, "x"]',
            """'youtube.category_ids[2]' is "x": must be a whole number, such as 100""",
        ),
        ("[26]", "[26]\nmin_views = 1.5", "'youtube.min_views' is 1.5: must be a whole number"),
        ("[26]", '[26]\nmin_views = "many"', """is "many": must be a whole number, such as 100"""),
        ("[26]", '[26]\nmin_aspect_ratio = "wide"', "must be a number, such as 1.5"),
        ("[26]", '[26]\ntranslate = "perhaps"', "must be true or false, such as true"),
        ("[26]", "[26]\nsearch_pages = 11", "'youtube.search_pages' is 11: must be at most 10"),
        ("[26]", "[26]\ntranscripts_per_hour = 0", "must be more than 0"),
        (
            "[26]",
            '[26]\nlanguage = "English"',
            (
                """'youtube.language' is "English": must be: language of the transcripts,"""
                """ such as "en\""""
            ),
        ),
        (
            "[26]",
            '[26]\n[reddit]\nsubreddit = "r/garden"',
            """'reddit.subreddit' is "r/garden": must be: name without r/, such as "Minecraft\"""",
        ),
        (
            "[26]",
            '[26]\n[wiki]\nurl = "garden.wiki"',
            "must be an address like https://minecraft.wiki",
        ),
        (
            "[26]",
            '[26]\n[wiki]\nurl = "http://garden.wiki"',
            "must begin with https://; plain http is for services on this machine alone",
        ),
        (
            "[26]",
            '[26]\n[release]\nversion = "2"',
            (
                """must be: version of the data: raise it for each published release,"""
                """ such as "1.0.0\""""
            ),
        ),
        (
            "[26]",
            "[26]\n[[release.creators]]\nname = ''",
            "'release.creators[1].name' is \"\": must not be empty",
        ),
        (
            "[26]",
            "[26]\n[pairs]\ninclude = ['x']\nmin_tokens = 70\nmax_tokens = 60",
            "'pairs': min_tokens is above max_tokens",
        ),
        ('title = "Garden"', "title = 5", """'title' is 5: must be text in quotes, such as "5\""""),
        ('title = "Garden"', 'title = "Garden"\nyoutub = 1', "unknown key 'youtub'"),
        (
            'title = "Garden"',
            'title = "Garden"\ntoxicity = "of"',
            """'toxicity' is "of": must be one of 'on' or 'off'""",
        ),
        ('title = "Garden"', 'title = "Garden"\ntoxicity = 5', "'toxicity' is 5: must be a table"),
        (
            'title = "Garden"',
            'title = "Garden"\nwiki = "garden.wiki"',
            """'wiki' is "garden.wiki": must be a table""",
        ),
        (
            'name = "garden"',
            'name = "My Garden"',
            """must be: short name, used in file names and titles, such as "stardew-valley\"""",
        ),
    ],
)
def test_a_wrong_value_is_told_in_a_users_words(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(ProfileError) as error:
        load_profile(write(tmp_path, GOOD.replace(old, new, 1)))
    said = str(error.value)
    assert message in said
    for word in ("input", "valid ", "tuple", "instance", "pydantic", "pattern", "[type"):
        assert word not in said.lower(), said


def test_a_long_value_is_cut(tmp_path):
    with pytest.raises(ProfileError) as error:
        load_profile(write(tmp_path, GOOD.replace('["roses"]', '"' + "rose " * 500 + '"')))
    assert len(str(error.value)) < 400
