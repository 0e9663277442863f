"""The keyword list: forms by rule, everyday words, and what a wrong list says."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.context import Run
from kb.core.errors import ProfileError
from kb.pairs.keyword_hits import keyword_lines
from kb.pairs.keyword_list import NEVER, forms, plural, read_keywords, scan, singular
from kb.pairs.keyword_proposal import propose
from kb.pairs.keywords import Keyword, load, make_keywords
from kb.pairs.matching import phrase
from kb.schema.wiki_page import PageNames

HEADER = "keyword\tkind\trule\tforms\n"

PAGES = [
    PageNames(
        "Rock Garden", ["Rockery", "Rock gardens", "RG/old", "Stone: a poem"], ["All", "Places"]
    ),
    PageNames("Spring", ["Springtime"], ["All", "Seasons"]),
    PageNames("Trough (planter)", ["Alpine trough", "Springtime"], ["All", "Tools"]),
    PageNames("Trough (river)", [], ["All"]),
    PageNames("Secateurs", ["Pruners, old"], ["All", "Tools"]),
    PageNames("1.19", [], ["All"]),
    PageNames("List of all the plants that anybody ever had", [], ["All"]),
    PageNames("Saxifrage", [], []),
    PageNames("Guides/Pruning", [], ["All", "Techniques"]),
    PageNames("Alpine", [], ["All", "Places"]),
]


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
    words = make_keywords([Keyword("Brick", "item"), Keyword("Bricks", "block")])
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
    assert read_keywords(path, 9) == [
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
        read_keywords(_list(tmp_path, text), 20)


def test_nothing_to_match_is_an_error() -> None:
    with pytest.raises(ProfileError, match="no keyword"):
        make_keywords([Keyword("Rook", "piece")], ["rook"])
    with pytest.raises(ProfileError, match="has no word"):
        make_keywords([Keyword("!!", "piece")])


@given(st.text(st.characters(max_codepoint=127)))
def test_plain_text_is_folded_as_any_other(text: str) -> None:
    assert phrase(text) == phrase(f"{text} \N{BLACK STAR}")


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


def test_keywords_with_examples(run: Run) -> None:
    lines = {line.keyword: line for line in keyword_lines(run, examples=2)}
    assert lines["Creeper"].matches > 30
    assert len(lines["Creeper"].examples) == 2
    assert "[creeper]" in lines["Creeper"].examples[0]
    assert lines["Bed"].rule == "topic"
    assert lines["Bed"].alone > 0
    assert {line.rule for line in lines.values()} <= {"", "topic", "near:20", "never"}
    assert list(keyword_lines(run, examples=2)) == list(lines.values())
    assert {line.kind for line in keyword_lines(run, kind="entity")} == {"entity"}


def test_rules_and_forms_of_a_row(tmp_path: Path) -> None:
    path = tmp_path / "list.tsv"
    path.write_text(
        f"# a comment\n{HEADER}Wolf\tmob\t\thound, dog\nBed\tblock\tnear\nAir\tblock\tnever\n"
        "Ice\tblock\tnear:30\n"
    )
    wolf, *others = read_keywords(path, 50)
    assert (wolf.name, wolf.kind, wolf.reach, wolf.more) == ("Wolf", "mob", None, ("hound", "dog"))
    assert [one.reach for one in others] == [50, NEVER, 30]


@pytest.mark.parametrize("line", ["Wolf", "Wolf\t", "!\tmob", "Wolf\tmob\tnaer", "a\tb\t\tc\td"])
def test_a_wrong_line_is_named_and_the_others_are_read(tmp_path: Path, line: str) -> None:
    path = tmp_path / "list.tsv"
    path.write_text(f"{HEADER}{line}\nBed\tblock\n")
    rows, problems = scan(path, 50)
    assert [number for number, _ in rows] == [3]
    assert [number for number, *_ in problems] == [2]
    with pytest.raises(ProfileError):
        read_keywords(path, 50)


def test_titles_redirects_and_categories_become_rows() -> None:
    found = propose(PAGES, taken={phrase("Alpine")})
    assert found.rows == [
        ("Saxifrage", "page", "", ""),
        ("Rock Garden", "places", "", "Rockery"),
        ("Spring", "seasons", "near", "Springtime"),
        ("Pruning", "techniques", "", ""),
        ("Secateurs", "tools", "", "Pruners old"),
        ("Trough", "tools", "", "Alpine trough"),
    ]
    assert found.left == {
        "no word": 1,
        "too long to be said": 1,
        "already in the list": 1,
        "another page has this name": 1,
    }


def test_what_is_proposed_is_a_list_that_can_be_read(tmp_path) -> None:
    path = tmp_path / "keywords.tsv"
    path.write_text(propose(PAGES).text("Rock Gardens"), encoding="utf-8")
    rows, problems = scan(path, 20)
    assert not problems
    assert len(rows) == 7
    assert {keyword.name: keyword.more for _, keyword in rows}["Spring"] == ("Springtime",)


def test_nothing_comes_of_nothing() -> None:
    assert propose([]).rows == []
