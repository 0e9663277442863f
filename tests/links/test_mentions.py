"""What is counted, held against a reckoning word by word; which page is an entity's own."""

import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import FatalError
from kb.links.build import aliases, own_pages
from kb.pairs.keywords import Keyword, Keywords, load, make
from tests.links import by_hand, made

TEXT = st.lists(st.sampled_from(made.WORDS), max_size=14).map(" ".join)
CUES = st.lists(TEXT.filter(bool), max_size=4).map(
    lambda texts: [(3 * at, text) for at, text in enumerate(texts)]
)
BLOCKS = st.lists(TEXT, max_size=4)
WORLD = {
    "videos": st.lists(st.tuples(TEXT, TEXT, CUES), max_size=3),
    "pages": st.lists(st.tuples(TEXT, BLOCKS), max_size=3),
    "posts": st.lists(st.tuples(TEXT, TEXT, BLOCKS), min_size=1, max_size=3),
    "comments": st.lists(TEXT, max_size=4),
}


def expected(world: dict[str, Any], keywords: Keywords) -> list[by_hand.Row]:
    found = []
    for number, (title, body, cues) in enumerate(world["videos"]):
        key = made.video_id(number)
        found += by_hand.mentions("youtube", key, "title", [title], keywords)
        found += by_hand.mentions("youtube", key, "body", [body], keywords)
        found += by_hand.transcript(key, cues, keywords)
    pages = [(number, title) for number, (title, _) in enumerate(world["pages"], made.FIRST_PAGE)]
    own = {
        (str(one.page_id), keywords.every[entity].name): one
        for entity, one in own_pages(keywords, pages, {}).items()
    }
    for number, (title, blocks) in enumerate(world["pages"], made.FIRST_PAGE):
        key = str(number)
        titled = by_hand.mentions("wiki", key, "title", [title], keywords)
        found += [row for row in titled if (key, row[0]) not in own]
        found += by_hand.mentions("wiki", key, "page", blocks, keywords)
    found += [
        (entity, "wiki", key, "title", one.how, one.names, None)
        for (key, entity), one in own.items()
    ]
    for number, (title, body, poll) in enumerate(world["posts"]):
        key = f"t3_p{number}"
        found += by_hand.mentions("reddit", key, "title", [title], keywords)
        found += by_hand.mentions("reddit", key, "body", [body, *poll], keywords)
    for number, body in enumerate(world["comments"]):
        found += by_hand.mentions("reddit", f"t1_c{number}", "comment", [body], keywords)
    return sorted(found, key=lambda row: row[:4])


@settings(max_examples=30, deadline=None)
@given(st.fixed_dictionaries(WORLD))
def test_counts_are_those_of_a_reckoning_word_by_word(world: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as place:
        root = Path(place, "data")
        made.fill(root, **world)
        run = made.run_at(root)
        summary = made.links(run)
        wanted = expected(world, load(run.profile))
        assert [tuple(row.values()) for row in made.rows(root)] == wanted
        assert summary["links"] == len(wanted)
        assert summary["mentions"] == sum(row[5] for row in wanted)


LISTED = [
    Keyword("Wolf", "entity", None, ("hound", "Canis")),
    Keyword("Dog", "entity", None, ("hound",)),
    Keyword("Air", "block", -1),
    Keyword("Iron Golem", "entity"),
]


def test_a_form_is_the_alias_of_one_entity_only() -> None:
    keywords = make(LISTED, exclude=["canis"])
    found = dict(zip([one.name for one in keywords.every], aliases(keywords), strict=True))
    assert found["Wolf"] == ["hound", "wolves"]
    assert found["Dog"] == ["dogs"]
    assert found["Iron Golem"] == ["iron golems", "irongolem", "irongolems"]


def test_links_need_clean_tables(tmp_path: Path) -> None:
    root = tmp_path / "data"
    root.mkdir()
    with pytest.raises(FatalError, match="nothing to link"):
        made.links(made.run_at(root))
    assert not any(root.iterdir())
