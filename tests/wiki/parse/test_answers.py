"""Tests of what an answer of the wiki's API says."""

from pathlib import Path
from typing import Any

import pytest

from kb.artifacts.purge_raw import strip_by_schema
from kb.store.rawlog import rawlog
from kb.store.state import tombstones
from kb.wiki.parse import answers
from tests.wiki.handmade_data import FRIDAY, MONDAY, page, put, told

PAGES: dict[str, str | int] = {"titles": "Fog"}


@pytest.mark.parametrize(
    ("params", "answer", "sound"),
    [
        (PAGES, {"query": {"pages": [{"pageid": 1, "ns": 0, "title": "Fog"}]}}, True),
        (PAGES, {"query": {"pages": [{"title": "Fog", "ns": 0, "missing": True}]}}, True),
        (PAGES, {"query": {"pages": {"1": {"title": "Fog"}}}}, False),
        (PAGES, {"query": {"pages": [{"pageid": "1"}]}}, False),
        (PAGES, {"query": []}, False),
        (PAGES, [], False),
    ],
    ids=str,
)
def test_an_answer_of_another_shape_is_a_problem(
    params: dict[str, str | int], answer: Any, sound: bool
) -> None:
    assert (answers.problem(params, answer) is None) == sound


def test_titles_that_the_wiki_writes_otherwise() -> None:
    query = {
        "normalized": [
            {"from": "fog", "to": "Fog"},
            {"fromencoded": True, "from": "caf%C3%A9", "to": "Café"},
        ],
        "interwiki": [{"title": "en:Fog", "iw": "en"}],
    }
    assert answers.renamed(query) == {"fog": "Fog", "café": "Café"}
    assert answers.elsewhere(query) == {"en:Fog"}


SITE = {
    "query": {
        "general": {"mainpage": "Main Page"},
        "namespaces": {"0": {"id": 0, "name": ""}, "102": {"id": 102, "name": "Cookbook"}},
    }
}


def names(*titles: str, ns: int = 0) -> list[dict[str, Any]]:
    return [{"pageid": 90 + n, "ns": ns, "title": title} for n, title in enumerate(titles)]


def test_the_newest_answer_counts_and_what_is_gone_does_not(tmp_path: Path) -> None:
    put(tmp_path, "site", (MONDAY, SITE))
    kiln = page(1, "Kiln", redirects=names("Oven", "Furnace"))
    made = page(2, "Cookbook:Risotto", ns=102, categories=names("Category:Rice", ns=14))
    put(
        tmp_path,
        "pages",
        (MONDAY, told(kiln, made, page(3, "Main Page"), page(4, "Gone"), page(5, "Purged"))),
        (FRIDAY, told(page(1, "Kiln", 2, redirects=names("Oven", "Hidden name")),
                      {"ns": 0, "title": "Gone", "pageid": 4, "missing": True})),
    )  # fmt: skip
    removed = [("5", "named"), ("Hidden name", "named")]
    tombstones.add_tombstones(tmp_path, "wiki", removed)
    assert answers.named_pages(tmp_path) == {
        "Cookbook:Risotto": ("Risotto", (), ("Rice",)),
        "Kiln": ("Kiln", ("Oven",), ()),
    }


def test_a_purged_name_leaves_the_pages_that_it_led_to() -> None:
    answer = told(page(1, "Kiln", redirects=names("Oven", "Hidden name")), page(2, "Vase"))
    envelope = rawlog.Envelope(MONDAY, rawlog.Request("x", {"titles": "Kiln|Vase"}), 200, answer)
    hidden = {"title": {"Hidden name"}, "": {"Hidden name"}}
    left = strip_by_schema("wiki", "pages", envelope, hidden)
    assert left is not None
    assert "Hidden name" not in str(left)
    assert [one["title"] for one in left.response["query"]["pages"]] == ["Kiln", "Vase"]
    assert left.response["query"]["pages"][0]["redirects"] == names("Oven")
    assert strip_by_schema("wiki", "pages", left, hidden) is left
