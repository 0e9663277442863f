"""Tests of `kb.core.config.profile.everyday_words`."""

import pytest

from kb.core.config.profile.everyday_words import is_everyday


@pytest.mark.parametrize(
    ("text", "expected"),
    [("bed", True), (" Beds ", True), ("glass", True), ("Netherite", False), ("bed frame", False)],
)
def test_a_single_usual_word_or_its_plural(text: str, expected: bool) -> None:
    assert is_everyday(text) is expected
