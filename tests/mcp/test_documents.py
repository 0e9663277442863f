"""Tests of what `read` shows of each source."""

import pytest

from tests.mcp.conftest import Ask, outside
from tests.search.made import video_id


def test_windows_of_a_video_around_a_second(ask: Ask) -> None:
    text = ask("read", ref=f"youtube:{video_id(3)}@0")
    assert "A series about animals." in text
    head = outside(text)
    assert f"https://www.youtube.com/watch?v={video_id(3)}" in head
    assert "[0:01:45 transcript]" in head


def test_a_page_by_id_by_title_and_by_the_link_of_an_older_revision(ask: Ask) -> None:
    answers = [
        outside(ask("read", ref=ref))
        for ref in ("wiki:14", "wiki:Camel", "https://wiki.example/w/Camel?oldid=3")
    ]
    assert all("licence CC-BY-SA-3.0" in head for head in answers)
    assert all("https://wiki.example/w/Camel?oldid=1004" in head for head in answers)
    assert "leather | 5" in ask("read", ref="wiki:14")


def test_a_comment_alone_names_its_post(ask: Ask) -> None:
    head = outside(ask("read", ref="reddit:t1_c003"))
    assert "https://www.reddit.com/comments/p003/" in head
    assert "comment, level 1" in head
    assert "no licence given" in head


@pytest.mark.parametrize(
    ("ref", "said"),
    [
        ("youtube:nonesuch00", "unknown video"),
        (f"youtube:{video_id(3)}@soon", "invalid second"),
        ("wiki:Nonesuch", "unknown page"),
        ("wiki:14#Nowhere", "no section 'Nowhere'"),
        ("reddit:t1_zzz", "unknown comment"),
        ("reddit:p003/c004", "no comment 'c004'"),
    ],
)
def test_a_wrong_place_is_an_error(ask: Ask, ref: str, said: str) -> None:
    answer = ask("read", ref=ref)
    assert answer.error
    assert said in answer
