"""What is counted, held against a reckoning word by word; which page is an entity's own."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.context import Run
from kb.core.errors import FatalError
from kb.links import texts
from kb.links.build import Own, aliases, own_pages
from kb.pairs.keywords import EXCLUDED, NEVER, Keyword, Keywords, load, make_keywords
from kb.schema import table
from kb.schema.wiki_page import PageNames
from kb.wiki.parse.answers import named_pages
from tests.inprocess import Here
from tests.links import made
from tests.pairs import reference
from tests.wiki import handmade_data as wiki

Row = tuple[str, str, str, str, str, int, "float | None"]

# -- the slow, obvious way to count who speaks of what: word by word, text after text --------------


class Hit(NamedTuple):
    """A keyword's number, and the first and last word of where it stands."""

    keyword: int
    first: int
    last: int


def hits(blocks: Sequence[str], keywords: Keywords) -> list[Hit]:
    """Keywords that count in a text of blocks, which no phrase crosses; a block's end is a word."""
    owner = dict(zip(keywords.phrases, keywords.of, strict=True))
    found, before = [], 0
    for block in blocks:
        for phrase, start, end in reference.find(block, list(owner)):
            if owner[phrase] != EXCLUDED:
                first, last = (before + word_at(block, at) for at in (start, end - 1))
                found.append(Hit(owner[phrase], first, last))
        before += len(block.split()) + 1
    certain = [one for one in found if keywords.every[one.keyword].reach is None]
    return [one for one in found if _counts(one, certain, keywords)]


def word_at(text: str, place: int) -> int:
    """Which of a text's words, parted by white space, holds a character."""
    return len(text[: place + 1].split()) - 1


def _counts(one: Hit, certain: list[Hit], keywords: Keywords) -> bool:
    reach = keywords.every[one.keyword].reach
    if reach is None:
        return True
    if reach == NEVER:
        return False
    return any(
        0 < one.first - other.last <= reach or 0 < other.first - one.last <= reach
        for other in certain
    )


def mentions(
    source: str, key: str, part: str, blocks: Sequence[str | None], keywords: Keywords
) -> list[Row]:
    """Rows of a text that is not timed."""
    count: dict[str, int] = {}
    for one in hits([block or "" for block in blocks], keywords):
        name = keywords.every[one.keyword].name
        count[name] = count.get(name, 0) + 1
    return [(name, source, key, part, "mention", n, None) for name, n in count.items()]


def transcript(key: str, cues: Sequence[tuple[int, str]], keywords: Keywords) -> list[Row]:
    """Rows of a transcript whose cues (second, text) last until the next, the last one second: each
    word gets an even share of its cue.
    """
    times: list[float] = []
    for at, (start, text) in enumerate(cues):
        end = cues[at + 1][0] if at + 1 < len(cues) else start + 1
        words = len(text.split())
        times += [
            (start * 1000 + (end - start) * 1000 * place // words) / 1000 for place in range(words)
        ]
    seen: dict[str, tuple[int, float]] = {}
    for one in hits([" ".join(text for _, text in cues)], keywords):
        name = keywords.every[one.keyword].name
        count, first = seen.get(name, (0, float("inf")))
        seen[name] = count + 1, min(first, times[one.first])
    return [
        (name, "youtube", key, "transcript", "mention", count, first)
        for name, (count, first) in seen.items()
    ]


# -- made worlds -----------------------------------------------------------------------------------

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


def expected(world: dict[str, Any], keywords: Keywords) -> list[Row]:
    found = []
    for number, (title, body, cues) in enumerate(world["videos"]):
        key = made.video_id(number)
        found += mentions("youtube", key, "title", [title], keywords)
        found += mentions("youtube", key, "body", [body], keywords)
        found += transcript(key, cues, keywords)
    pages = [(number, title) for number, (title, _) in enumerate(world["pages"], made.FIRST_PAGE)]
    own = {
        (str(one.page_id), keywords.every[entity].name): one
        for entity, one in own_pages(keywords, pages, {}).items()
    }
    for number, (title, blocks) in enumerate(world["pages"], made.FIRST_PAGE):
        key = str(number)
        titled = mentions("wiki", key, "title", [title], keywords)
        found += [row for row in titled if (key, row[0]) not in own]
        found += mentions("wiki", key, "page", blocks, keywords)
    found += [
        (entity, "wiki", key, "title", one.how, one.names, None)
        for (key, entity), one in own.items()
    ]
    for number, (title, body, poll) in enumerate(world["posts"]):
        key = f"t3_p{number}"
        found += mentions("reddit", key, "title", [title], keywords)
        found += mentions("reddit", key, "body", [body, *poll], keywords)
    for number, body in enumerate(world["comments"]):
        found += mentions("reddit", f"t1_c{number}", "comment", [body], keywords)
    return sorted(found, key=lambda row: row[:4])


@settings(max_examples=12, deadline=None)
@given(st.fixed_dictionaries(WORLD))
def test_counts_are_those_of_a_reckoning_word_by_word(world: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as place:
        root = Path(place, "data")
        made.fill(root, **world)
        run = made.run_at(root)
        summary = made.links(run)
        wanted = expected(world, load(run.profile))
        columns = [name for name in table("links/links").names() if not name.endswith("_id")]
        assert [tuple(row[name] for name in columns) for row in made.rows(root)] == wanted
        assert summary["links"] == len(wanted)
        assert summary["mentions"] == sum(row[5] for row in wanted)


LISTED = [
    Keyword("Wolf", "entity", None, ("hound", "Canis")),
    Keyword("Dog", "entity", None, ("hound",)),
    Keyword("Air", "block", -1),
    Keyword("Iron Golem", "entity"),
]


def test_a_form_is_the_alias_of_one_entity_only() -> None:
    keywords = make_keywords(LISTED, exclude=["canis"])
    found = dict(zip([one.name for one in keywords.every], aliases(keywords), strict=True))
    assert found["Wolf"] == ["hound", "hounds", "wolves"]
    assert found["Dog"] == ["dogs"]
    assert found["Iron Golem"] == ["iron golems", "irongolem", "irongolems"]


def test_links_need_clean_tables(tmp_path: Path) -> None:
    root = tmp_path / "data"
    root.mkdir()
    with pytest.raises(FatalError, match="nothing to link"):
        made.links(made.run_at(root))
    assert not any(root.iterdir())


@pytest.mark.parametrize(
    ("pages", "names", "wanted"),
    [
        ({7: "Wolf"}, {}, {"Wolf": (7, "title", 1)}),
        ({7: "WOLF", 9: "Wolf"}, {}, {"Wolf": (9, "title", 1)}),
        ({7: "Wolves"}, {}, {"Wolf": (7, "alias", 1)}),
        ({7: "Wolves", 9: "Wolf"}, {}, {"Wolf": (9, "title", 1)}),
        ({7: "Canidae", 8: "Wolves"}, {"Canidae": ("wolf",)}, {"Wolf": (7, "alias", 1)}),
        ({7: "Wolf"}, {"Wolf": ("Wolves", "Canis", "Pet")}, {"Wolf": (7, "title", 3)}),
        ({7: "Wolf (mob)"}, {}, {"Wolf": (7, "title", 1)}),
        ({7: "Wolf (mob)", 8: "Den"}, {"Den": ("Wolf",)}, {"Wolf": (8, "alias", 1)}),
        ({7: "Hound"}, {}, {"Wolf": (7, "alias", 1)}),  # a form stands for the first that has it
        ({7: "Air"}, {}, {"Air": (7, "title", 1)}),  # everyday words may be titles
        ({7: "Pets"}, {"Pets": ("Dog", "Wolf")}, {"Dog": (7, "alias", 1), "Wolf": (7, "alias", 1)}),
        ({7: "Iron golems in villages", 8: "irongolem"}, {}, {"Iron Golem": (8, "alias", 1)}),
        ({7: "Wolf den"}, {}, {}),
    ],
)
def test_an_entity_s_page_by_title_or_redirect(
    pages: dict[int, str], names: dict[str, tuple[str, ...]], wanted: dict[str, tuple[Any, ...]]
) -> None:
    keywords = make_keywords(LISTED)
    called = {title: PageNames(title, redirects) for title, redirects in names.items()}
    for order in (1, -1):
        found = own_pages(keywords, list(pages.items())[::order], called)
        assert {keywords.every[at].name: one for at, one in found.items()} == {
            name: Own(*one) for name, one in wanted.items()
        }


def test_redirects_come_from_the_wiki_s_answers(run: Run, here: Here) -> None:
    """Without their namespace, as pages are; the newest answer counts."""
    spaces = {str(n): {"id": n, "name": name} for n, name in ((0, ""), (102, "Cookbook"))}
    told = [{"ns": 0, "title": title} for title in ("Wolf", "Pets")]
    older = wiki.page(11, "Canidae", redirects=[{"ns": 0, "title": "Iron Golem"}])
    newer = wiki.page(11, "Canidae", redirects=told)
    named = {"ns": 102, "redirects": [{"ns": 102, "title": "Cookbook:Dragon"}]}
    other = wiki.page(12, "Cookbook:Bed", **named)
    wiki.put(run.root, "site", (wiki.MONDAY, {"query": {"namespaces": spaces, "general": {}}}))
    wiki.put(run.root, "pages", (wiki.TUESDAY, wiki.told(newer)), (wiki.MONDAY, wiki.told(older)))
    wiki.put(run.root, "pages", (wiki.MONDAY, wiki.told(other)))
    assert named_pages(run.root) == {
        "Canidae": PageNames("Canidae", ("Pets", "Wolf")),
        "Cookbook:Bed": PageNames("Bed", ("Dragon",)),
    }
    made.fill(run.root, pages=[("Nothing", []), ("Canidae", []), ("Cookbook:Bed", [])])
    assert here("links", "--data", str(run.root), "--profile", str(run.profile.path)).code == 0
    found = {row["entity"]: row["wiki_page_id"] for row in made.rows(run.root, "entities")}
    assert {name: page for name, page in found.items() if page is not None} == {
        "Bed": 12,
        "Ender Dragon": 12,
        "Wolf": 11,
    }


def test_pieces_of_any_size_count_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Texts are looked through some megabytes at a time; what belongs to one thing stays whole."""
    blocks = ["an iron", "golem and a bed", "iron golem"]
    pages = [(f"Page {n}", blocks * (n % 4)) for n in range(9)]
    videos = [("Creeper", "x" * n, [(0, "oak log"), (2, "oak log")]) for n in range(5)]
    found = []
    for size in (1, 20, 1 << 20):
        monkeypatch.setattr(texts, "_BYTES", size)
        root = tmp_path / str(size) / "data"
        made.fill(root, videos, pages, [("t", "wolf", ["bed", "wolf"])], ["creeper"] * 3)
        made.links(made.run_at(root))
        found.append(made.rows(root))
    assert found[0] == found[1] == found[2]
    paged = [row for row in found[0] if row["part"] == "page"]
    counted = {(row["entity"], row["key"]): row["count"] for row in paged}
    assert counted["Iron Golem", "13"] == 3
    assert counted["Bed", "13"] == 3  # near the golem of the next block
