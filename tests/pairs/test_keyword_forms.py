"""Tests of `kb.pairs.keyword_list`."""

import pytest

from kb.pairs.keyword_list import forms, plural, singular


@pytest.mark.parametrize(
    ("one", "many"),
    [
        ("creeper", "creepers"),
        ("torch", "torches"),
        ("berry", "berries"),
        ("key", "keys"),
        ("wolf", "wolves"),
        ("sheep", "sheep"),
        ("glass", "glasses"),
        ("bookshelf", "bookshelves"),
        ("cactus", "cacti"),
        ("box", "boxes"),
        ("potato", "potatoes"),
    ],
)
def test_singular_and_plural(one: str, many: str) -> None:
    assert plural(one) == plural(many) == many or one == "glass"
    assert singular(many) in (one, many)
    assert singular(one) == one


def test_forms() -> None:
    assert forms("block of diamond") >= {"block of diamond", "blocks of diamond"}
    assert forms("iron golem") >= {"iron golem", "iron golems", "irongolem", "irongolems"}
    assert forms("oak planks") >= {"oak planks", "oak plank"}
    assert forms("cobblestone", {"cobble", "stone"}) >= {"cobble stone"}
