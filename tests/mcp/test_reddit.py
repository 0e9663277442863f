"""Tests of what `read` shows of a thread."""

import pytest

from tests.mcp.conftest import Ask, outside


def test_a_comment_alone_names_its_post(ask: Ask) -> None:
    head = outside(ask("read", ref="reddit:t1_c003"))
    assert "https://www.reddit.com/comments/p003/" in head
    assert "comment, level 1" in head
    assert "no licence given" in head


@pytest.mark.parametrize(
    ("ref", "said"),
    [("reddit:t1_zzz", "unknown comment"), ("reddit:p003/c004", "no comment 'c004'")],
)
def test_a_wrong_place_is_an_error(ask: Ask, ref: str, said: str) -> None:
    answer = ask("read", ref=ref)
    assert answer.error
    assert said in answer
