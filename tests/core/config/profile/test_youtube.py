"""Tests of `kb.core.config.profile.youtube`: wrong values are named."""

from pathlib import Path

import pytest

from tests.core.config.profile.refused import refuse


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        (
            "category_ids",
            "categoy_ids",
            ["unknown key 'youtube.categoy_ids', did you mean 'category_ids'"],
        ),
        (
            "category_ids = [26]",
            'category_ids = [26]\ntranscripts = "requird"',
            ["'youtube.transcripts' is \"requird\"", "did you mean 'required'"],
        ),
        (
            "category_ids = [26]",
            "category_ids = [26]\nmin_views = -1",
            ["'youtube.min_views' is -1: must be at least 0"],
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
            ['\'youtube.keywords\' is "roses": must be a list in brackets, such as ["roses"]'],
        ),
        (
            '["roses"]',
            "[7]",
            ["'youtube.keywords[1]' is 7: must be text in quotes, such as \"7\""],
        ),
        (
            '["roses"]',
            '["roses", ""]',
            ['\'youtube.keywords\' is ["roses", ""]: holds an empty phrase'],
        ),
        (
            '["roses"]',
            "[]",
            ["'youtube.keywords' is []: must hold at least 1"],
        ),
        (
            "[26]",
            "26",
            ["'youtube.category_ids' is 26: must be a list in brackets, such as [26]"],
        ),
        (
            "[26]",
            '[20, "x"]',
            ["'youtube.category_ids[2]' is \"x\": must be a whole number, such as 100"],
        ),
        (
            "[26]",
            "[26]\nmin_views = 1.5",
            ["'youtube.min_views' is 1.5: must be a whole number"],
        ),
        (
            "[26]",
            '[26]\nmin_views = "many"',
            ['is "many": must be a whole number, such as 100'],
        ),
        (
            "[26]",
            '[26]\nmin_aspect_ratio = "wide"',
            ["must be a number, such as 1.5"],
        ),
        (
            "[26]",
            '[26]\ntranslate = "perhaps"',
            ["must be true or false, such as true"],
        ),
        (
            "[26]",
            "[26]\nsearch_pages = 11",
            ["'youtube.search_pages' is 11: must be at most 10"],
        ),
        (
            "[26]",
            "[26]\ntranscripts_per_hour = 0",
            ["must be more than 0"],
        ),
        (
            "[26]",
            '[26]\nlanguage = "English"',
            [
                (
                    "'youtube.language' is \"English\": must be: language of the transcripts, "
                    'such as "en"'
                )
            ],
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, old: str, new: str, fragments: list[str]) -> None:
    refuse(tmp_path, old, new, *fragments)
