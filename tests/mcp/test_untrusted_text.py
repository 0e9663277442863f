"""Retrieved text can't leave its markers."""

import re

from hypothesis import given
from hypothesis import strategies as st

from kb.mcp.untrusted_text import AnswerPart, Fence, fit
from tests.mcp.conftest import FENCE, ORDER, Ask, outside


def test_an_order_in_a_comment_comes_back_fenced(ask: Ask) -> None:
    sql = "SELECT comment_id, body FROM reddit_comments WHERE comment_id = 'c900'"
    wrong = "SELECT body::INT FROM reddit_comments WHERE comment_id = 'c900'"
    tokens = set()
    for text in (
        ask("search", query="xylophagous"),
        ask("read", ref="reddit:p000/c900"),
        ask("read", ref="reddit:p000"),
        ask("query", sql=sql),
        ask("query", sql=wrong),
    ):
        assert ORDER in text or "xylophagous" in text
        assert ORDER not in outside(text)
        assert not re.search(r"[\x1b\U000e0000-\U000e007f]", text)
        tokens |= {token for token, _ in FENCE.findall(text)}
        (named,) = set(re.findall(r"Text between <material (\w+)>", text))
        assert {token for token, part in FENCE.findall(text)} == {named}
    assert len(tokens) == 5


@given(st.text(max_size=200), st.integers(200, 500))
def test_a_fence_holds_any_text(text: str, size: int) -> None:
    fence = Fence()
    answer = fit(fence, "head", [AnswerPart("facts", text)] * 3, "{} left".format, size)
    assert len(answer) <= size
    (token,) = set(re.findall(r"<material (\w{16})>", fence.note))
    assert answer.count(f"</material {token}>") == answer.count(f"\n<material {token}>\n")
    assert answer.encode()
