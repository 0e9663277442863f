"""Tests of `kb.links.build`."""

from typing import Any

import pytest

from kb.core.context import Run
from kb.links.build import Names, Own, own_pages
from kb.pairs.keywords import make
from tests.inprocess import Here
from tests.links import made
from tests.links.test_build import pipeline
from tests.links.test_mentions import LISTED
from tests.wiki import handmade_data as wiki


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
    keywords = make(LISTED)
    called = {title: Names(title, redirects) for title, redirects in names.items()}
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
    assert pipeline.names(run) == {
        "Canidae": Names("Canidae", ("Pets", "Wolf")),
        "Cookbook:Bed": Names("Bed", ("Dragon",)),
    }
    made.fill(run.root, pages=[("Nothing", []), ("Canidae", []), ("Cookbook:Bed", [])])
    assert here("links", "--data", str(run.root), "--profile", str(run.profile.path)).code == 0
    found = {row["entity"]: row["wiki_page_id"] for row in made.rows(run.root, "entities")}
    assert {name: page for name, page in found.items() if page is not None} == {
        "Bed": 12,
        "Ender Dragon": 12,
        "Wolf": 11,
    }
