"""Languages are one where their codes differ, and differ where their codes are alike."""

import pytest
from langcodes import Language

from kb.core.languages import (
    code_of,
    is_language,
    is_same_language,
    primary_language,
    tag,
    three_letters,
)

ALIKE = [
    ("en", "eng", "en-001", "en-GB", "en_US", "EN"),
    ("es", "spa", "es-419", "es-MX"),
    ("de", "ger", "deu", "de-AT", "de-1996"),
    ("zh", "chi", "zho", "cmn", "zh-Hant", "zh-Hans-CN", "zh_TW"),
    ("he", "iw", "heb", "iw-IL"),
    ("id", "in", "ind"),
    ("nb", "no", "nob", "no-NO"),
    ("nn", "nno"),
    ("sv", "swe"),
    ("fr", "fre", "fra", "fr-CA"),
    ("yue", "yue-HK"),
    ("yi", "ji"),
]


@pytest.mark.parametrize("codes", ALIKE, ids=lambda codes: codes[0])
def test_a_language_is_one_whatever_its_code(codes: tuple[str, ...]) -> None:
    assert {primary_language(code) for code in codes} == {codes[0]}
    assert all(map(is_language, codes))
    others = [other for group in ALIKE if group is not codes for other in group]
    assert not any(is_same_language(code, other) for code in codes for other in others)


@pytest.mark.parametrize("code", ["und", "mul", "zxx", "english", "live_chat", "xx", "", "12"])
def test_what_is_no_language(code: str) -> None:
    assert not is_language(code)
    assert tag(code) == code


def test_scripts_and_regions_stay_in_a_tag() -> None:
    codes = ("zh-Hant", "es-419", "iw_IL", "EN-gb", "sr-Latn-RS", "ca-valencia")
    assert [tag(code) for code in codes] == [
        "zh-Hant", "es-419", "he-IL", "en-GB", "sr-Latn-RS", "ca-valencia",
    ]  # fmt: skip


def test_names_as_speech_recognition_writes_them() -> None:
    names = {
        "english": "en", "Greek": "el", "haitian creole": "ht", "castilian": "es",
        "norwegian": "nb", "burmese": "my", "en": "en", "iw": "he", "no such": "no such",
    }  # fmt: skip
    assert {name: code_of(name) for name in names} == names


def test_three_letters_of_a_language_are_those_of_its_name() -> None:
    codes = ("de", "ger", "zh-Hant", "sv", "he", "en-001")
    assert [three_letters(code) for code in codes] == ["deu", "deu", "zho", "swe", "heb", "eng"]
    assert three_letters("xx") is None
    assert all(Language.get(code).is_valid() for group in ALIKE for code in group)
