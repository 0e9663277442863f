"""Tests of `kb.search.build`."""

from pathlib import Path

import pytest

from kb.search.answers import search, suggest
from kb.search.build import index
from tests.filters.made import run_at
from tests.search.test_answers import EVERY, found, posts


def test_words_are_folded_and_stemmed_by_the_profiles_language(tmp_path: Path) -> None:
    posts(tmp_path, "Cafe\u0301 d'Écume", "the Häuser were sold", "岩島に住む", title="Título")
    index(run_at(tmp_path))
    for words in ("cafe", "CAFÉ", "e\u0301cume", "d'ecume", '"café d ecume"'):
        assert found(tmp_path, words) == ["Café d'Écume"], words
    assert found(tmp_path, "selling houses") == []
    assert found(tmp_path, "haus") == []
    assert found(tmp_path, "häuser") == ["the Häuser were sold"]
    assert found(tmp_path, "岩島に住む") == ["岩島に住む"]
    assert found(tmp_path, "岩島*") == ["岩島に住む"]
    assert len(found(tmp_path, "titulo")) == 3
    index(run_at(tmp_path, language="de"))
    assert found(tmp_path, "haus") == ["the Häuser were sold"]
    assert index(run_at(tmp_path, language="xx"))["indexed"] == ["reddit"]
    assert found(tmp_path, "haus") == []
    assert found(tmp_path, "HAUSER") == ["the Häuser were sold"]


def test_words_in_order_rank_higher_with_other_small_words_between(tmp_path: Path) -> None:
    apart = "one wolf, two wolf, a wolf to tame; it is tame, so tame"
    bodies = ["you tame a wolf", "you tame your new wolf", "wolf tame", apart]
    posts(tmp_path, *bodies, *["nothing of it"] * 20)
    index(run_at(tmp_path))
    for words in ("how to tame a wolf", "tame the wolf?"):
        assert set(found(tmp_path, words)[:2]) == set(bodies[:2])
        assert set(found(tmp_path, words)[2:]) == set(bodies[2:])
    assert found(tmp_path, "tame wolf")[0] == bodies[0]
    assert found(tmp_path, "wolf tame")[0] == bodies[2]


def test_a_snippet_is_of_the_passage_and_not_the_title_again(tmp_path: Path) -> None:
    posts(tmp_path, "a text about something else", "", title="Saltstone")
    index(run_at(tmp_path))
    one, two = search(tmp_path, "saltstone", sources=["reddit"], only=EVERY)
    assert {(one.text, one.snippet), (two.text, two.snippet)} == {
        ("a text about something else", "a text about something else"),
        ("Saltstone", "**Saltstone**"),  # which has no other text
    }


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("creper", "creeper"),
        ("Crepers sawn here", "creepers spawn here"),  # stems
        ("vilager trading", "villagers trading"),
        ("creeper", ""),
        ("zzzzqx", ""),
        ("cre*", ""),
        ("+creper -cow", "+creeper -cow"),
    ],
)
def test_a_misspelt_word_is_suggested_as_it_is_written(
    tmp_path: Path, typed: str, meant: str
) -> None:
    posts(tmp_path, "Creepers spawn here", "the creeper runs, a creeper", "Villagers are trading")
    index(run_at(tmp_path))
    assert suggest(tmp_path, typed) == meant
