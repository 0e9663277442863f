"""Keywords proposed from a wiki's names."""

from kb.pairs.keyword_list import scan
from kb.pairs.keyword_proposal import PageNames, propose
from kb.pairs.matching import phrase

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
    assert {row.keyword.name: row.keyword.more for row in rows}["Spring"] == ("Springtime",)


def test_nothing_comes_of_nothing() -> None:
    assert propose([]).rows == []
