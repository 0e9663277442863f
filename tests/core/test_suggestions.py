"""What a misspelt name may mean."""

import pytest

from kb.core.suggestions import similar

RULES = ["topic", "near", "never", "always"]
KEYS = ["min_views", "max_views", "include", "exclude", "language", "languages"]


@pytest.mark.parametrize(
    ("name", "names", "wanted"),
    [
        ("naer", RULES, ["near"]),
        ("nevr", RULES, ["never"]),
        ("NEVER", RULES, ["never"]),
        ("alwyas", RULES, ["always"]),
        ("neer", RULES, []),  # either, and one is the opposite of what was meant
        ("ner", RULES, []),
        ("mx_views", KEYS, ["max_views"]),
        ("min_vews", KEYS, ["min_views"]),
        ("m_views", KEYS, []),
        ("exclud", KEYS, ["exclude"]),
        ("max_words", ["min_words"], []),  # what there is not at all
        ("langage", KEYS, ["language", "languages"]),
        ("Langage", ["Language"], ["Language"]),
        ("zzz", KEYS, []),
    ],
)
def test_similar_names_are_proposed_and_the_opposite_never(
    name: str, names: list[str], wanted: list[str]
) -> None:
    assert similar(name, names) == wanted
