"""Tests of what `read` shows of a wiki page."""

import pytest

from tests.mcp.conftest import Ask, outside


def test_a_page_by_id_by_title_and_by_the_link_of_an_older_revision(ask: Ask) -> None:
    answers = [
        outside(ask("read", ref=ref))
        for ref in ("wiki:14", "wiki:Camel", "https://wiki.example/w/Camel?oldid=3")
    ]
    assert all("licence CC-BY-SA-3.0" in head for head in answers)
    assert all("https://wiki.example/w/Camel?oldid=1004" in head for head in answers)
    assert "leather | 5" in ask("read", ref="wiki:14")


@pytest.mark.parametrize(
    ("ref", "said"),
    [("wiki:Nonesuch", "unknown page"), ("wiki:14#Nowhere", "no section 'Nowhere'")],
)
def test_a_wrong_place_is_an_error(ask: Ask, ref: str, said: str) -> None:
    answer = ask("read", ref=ref)
    assert answer.error
    assert said in answer
