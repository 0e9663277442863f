"""Tests of `kb.search.build`."""

from pathlib import Path

import pytest

from kb.search import tantivy_index
from kb.search.answers import search, suggest
from kb.search.build import index
from kb.search.passage import Passage, pieces, plain
from kb.search.query import Term, function_words, question
from kb.search.ranking import Only, Weights, rank
from kb.search.tantivy_index import PassageIndex
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
    for words in ("岩島*", "住む", "島に", "島"):
        assert found(tmp_path, words) == ["岩島に住む"], words
    assert found(tmp_path, "島岩") == []
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
        ("vilager made", "villagers made"),
        ("creeper", ""),
        ("zzzzqx", ""),
        ("cre*", ""),
        ("+creper -cow", "+creeper -cow"),
        ("how do I make a creeper", ""),  # what only asks is not looked for
    ],
)
def test_a_misspelt_word_is_suggested_as_it_is_written(
    tmp_path: Path, typed: str, meant: str
) -> None:
    posts(tmp_path, "Creepers spawn here", "the creeper runs, a creeper", "Villagers made a trade")
    index(run_at(tmp_path))
    assert suggest(tmp_path, typed) == meant


def test_the_same_rows_give_the_same_answers_in_any_number_of_segments(tmp_path: Path) -> None:
    passages = [
        Passage("post", f"t3_{n}", f"{n // 3}", "t", f"an elm and {n % 7} oaks", "", "2023-01-01")
        for n in range(20_000)
    ]
    indexes = []
    for name, heap in (("small", 30 << 20), ("large", 256 << 20)):
        (tmp_path / name).mkdir()
        tantivy_index.write_index(tmp_path / name, "", passages, lambda _: None, heap)
        indexes.append(PassageIndex(tmp_path / name, ""))
    for words in ("elm", "6 oaks", "oaks elm 3"):
        asked = question(words)
        first, again = (
            [
                (one.score, one.number, index.passage(one.address))
                for one in rank(by_source, asked, Weights(by_source, asked), Only(limit=50))
            ]
            for index in indexes
            for by_source in [{"reddit": index}]
        )
        assert first == again
        assert [number for _, number, _ in first] == sorted(number for _, number, _ in first)


def test_lines_are_joined_to_pieces_and_long_ones_are_divided() -> None:
    assert list(pieces(["a b", "c", "d e f g h", "i"], 3)) == ["a b\nc", "d e f", "g h\ni"]
    assert list(pieces([])) == []


def test_plain_text_has_no_control_characters_and_composed_letters() -> None:
    assert plain(None) == ""
    assert plain("a\x00b\ttab") == "a b\ttab"
    assert plain("cafe\u0301") == "café"


def test_what_is_typed_becomes() -> None:
    assert question("how-to 'ride'").terms == (Term("how to"), Term("ride"))
    assert question("how-to 'ride'").run == ("how", "to", "ride")
    assert question("wolf -dog").run == question("wolf dog*").run == ()
    assert question("wolf -dog wolf").run == ("wolf", "wolf")
    asked = question('wolf "bed rock" craft* +iron -dog -"a b"')
    craft = Term("craft", prefix=True)
    assert asked.terms == (Term("wolf"), Term("bed rock"), craft, Term("iron"))
    assert asked.needed == (Term("bed rock"), Term("iron"))
    assert asked.barred == (Term("dog"), Term("a b"))
    assert question("wolf,dog").terms == question("wolf/dog").terms == question("wolf dog").terms
    assert question("wolf,craft*").terms == (Term("wolf"), craft)
    assert question("wolf -iron,dog").barred == (Term("iron"), Term("dog"))
    small = function_words("en").__contains__
    asked = question("How do I tame the wolf?", small)
    assert asked.terms == (Term("tame"), Term("wolf"))
    assert len(question("how to", small).terms) == 2
    assert len(question('+how "to the" wolf', small).terms) == 3
    assert question("釉薬が青い TNT").terms == tuple(
        map(Term, ("釉薬", "薬が", "が青", "青い", "TNT"))
    )
    assert question('釉薬 "青い窯"').needed == (Term("青い窯"),)
    assert question("x" + " y z" * 100).terms == question("x y z").terms
    assert len(question(" ".join(map(str, range(100)))).terms) == 32
