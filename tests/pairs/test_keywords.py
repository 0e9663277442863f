"""The keyword list: forms by rule, everyday words, and what a wrong list says."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.errors import ProfileError
from kb.pairs.keywords import NEVER, Keyword, load, make, read
from kb.pairs.matching import phrase


@pytest.mark.parametrize(
    ("name", "folded"),
    [
        ("Jack o'Lantern", "jack o lantern"),
        ("TNT", "tnt"),
        ("Café", "café"),
        ("  Ender-Dragon ", "ender dragon"),
        ("!!", ""),
    ],
)
def test_folded_names(name: str, folded: str) -> None:
    assert phrase(name) == folded


def test_own_name_wins_over_a_derived_form() -> None:
    words = make([Keyword("Brick", "item"), Keyword("Bricks", "block")])
    owner = {form: words.every[at].name for form, at in zip(words.phrases, words.of, strict=True)}
    assert owner["bricks"] == "Bricks"
    assert owner["brick"] == "Brick"


def test_the_shipped_list() -> None:
    words = load(load_profile("minecraft"))
    kinds = {keyword.kind for keyword in words.every}
    assert kinds >= {"entity", "block", "item", "biome", "structure", "effect"}
    assert len(words.every) > 1500
    names = {keyword.name: keyword for keyword in words.every}
    assert names["Creeper"].reach is None
    assert names["Bed"].reach == names["Chest"].reach == names["Stick"].reach == 20
    assert names["Air"].reach == NEVER
    assert not [
        keyword.name for keyword in words.every if re.search(r"[_%.]|minecraft", keyword.name)
    ]


def _list(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "words.tsv"
    path.write_text(text)
    return path


def test_a_list_of_ones_own(tmp_path: Path) -> None:
    path = _list(
        tmp_path,
        "# mine\nkeyword\tkind\trule\tforms\nRook\tpiece\nPawn\tpiece\tnear:7\tfoot"
        " soldier, peon\n\nMove\tterm\tnever\nRow\tplace\talways\nKing\tpiece\tnear\n",
    )
    assert read(path, 9) == [
        Keyword("Rook", "piece"),
        Keyword("Pawn", "piece", 7, ("foot soldier", "peon")),
        Keyword("Move", "term", NEVER),
        Keyword("Row", "place"),
        Keyword("King", "piece", 9),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Rook\tpiece\n", ":1: the first line must read keyword, kind, rule, forms"),
        ("keyword\tkind\trule\tforms\nRook\n", ":2: a line has a keyword, a kind"),
        ("keyword\tkind\trule\tforms\nRook\tpiece\tnaer\n", ":2: the rule is 'naer'; known: near"),
    ],
)
def test_a_wrong_list_says_where(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ProfileError, match=re.escape(message)):
        read(_list(tmp_path, text), 20)


def test_nothing_to_match_is_an_error() -> None:
    with pytest.raises(ProfileError, match="no keyword"):
        make([Keyword("Rook", "piece")], ["rook"])
    with pytest.raises(ProfileError, match="has no word"):
        make([Keyword("!!", "piece")])


@given(st.text(st.characters(max_codepoint=127)))
def test_plain_text_is_folded_as_any_other(text: str) -> None:
    assert phrase(text) == phrase(f"{text} \N{BLACK STAR}")
