"""The question of `kb profile check --online` to Reddit."""

import pytest

from kb.core.config.profile.base import ERROR, NOTE, WARNING, QuestionCost
from kb.reddit.crawl.online import question
from tests.reddit.work import Work


def test_the_subreddit_s_own_page_is_asked_for_once(few: Work) -> None:
    cost = QuestionCost()
    assert question(few.run(), cost).level == NOTE
    assert cost.requests == len(few.sandbox.ledger.requests()) == 2  # the token, the page


@pytest.mark.parametrize(
    ("status", "body", "level"),
    [
        (200, {"kind": "t5", "data": {"display_name": "Minecraft", "over18": True}}, WARNING),
        (403, {"reason": "private", "message": "Forbidden"}, ERROR),
        (404, {"reason": "banned", "message": "Not Found"}, ERROR),
    ],
)
def test_what_is_wrong_with_it_is_found(few: Work, status: int, body: object, level: str) -> None:
    few.sandbox.faults.add("/about", status=status, body=body, times=None)
    assert question(few.run(), QuestionCost()).level == level
