"""Tests of what `read` shows of a video."""

import pytest

from tests.mcp.conftest import Ask, outside
from tests.search.made import video_id


def test_windows_around_a_second(ask: Ask) -> None:
    text = ask("read", ref=f"youtube:{video_id(3)}@0")
    assert "A series about animals." in text
    head = outside(text)
    assert f"https://www.youtube.com/watch?v={video_id(3)}" in head
    assert "[0:01:45 transcript]" in head


@pytest.mark.parametrize(
    ("ref", "said"),
    [("youtube:nonesuch00", "unknown video"), (f"youtube:{video_id(3)}@soon", "invalid second")],
)
def test_a_wrong_place_is_an_error(ask: Ask, ref: str, said: str) -> None:
    answer = ask("read", ref=ref)
    assert answer.error
    assert said in answer
