"""Tests of what an answer of the wiki's API says."""

from typing import Any

import pytest

from kb.wiki.parse import answers

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
