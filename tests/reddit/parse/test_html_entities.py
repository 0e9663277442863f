"""Entities of dumps: what somebody wrote comes back, whether the record was escaped or not."""

import html
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.reddit.parse import answers as parse
from kb.reddit.parse.records import resolve, unescaped, was_never_escaped
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request

LINKS = load_profile("minecraft").section("reddit").links

written = st.lists(
    st.sampled_from(["&", "<", ">", ";", "amp;", "&lt;", "&nbsp;", "#39;", "#x2F;", "notit;", "a "])
    | st.text(max_size=3)
).map("".join)


@given(written)
def test_what_reddit_escapes_comes_back_as_it_was_written(text: str) -> None:
    assert unescaped(html.escape(text, quote=False)) == text


@given(written)
def test_a_text_that_was_never_escaped_stays(text: str) -> None:
    assert unescaped(text) in (text, html.unescape(text))
    if was_never_escaped([text]):
        assert unescaped(text) == text
    else:
        assert not {"<", ">"} & set(text)
        assert html.unescape(text) == unescaped(text)


@pytest.mark.parametrize(
    ("text", "bare"),
    [
        ("Tom & Jerry", True),
        ("AT&T;", True),
        ("a=1&copy=2", True),
        ("&notit;", True),
        ("ends in &", True),
        ("&#;", True),
        ("&#12x;", True),
        ("&amp;&lt;&gt;", False),
        ("&quot;&#39;&#x27;&nbsp;", False),
    ],
)
def test_a_bare_ampersand_begins_no_entity(text: str, *, bare: bool) -> None:
    assert was_never_escaped([text]) is bare


@pytest.mark.parametrize("sign", ["a < b", "a > b", "a & b"])
@pytest.mark.parametrize("where", ["title", "selftext"])
def test_one_text_tells_for_the_whole_record(sign: str, where: str) -> None:
    record = {
        "title": "how to write &lt;b&gt;",
        "selftext": "&amp;nbsp;",
        "url": "https://example.org/?a=1&amp;b=2",
        "poll_data": {"options": [{"text": "R&amp;D"}]},
    }
    literal = record | {where: sign}
    assert resolve(literal) is literal
    assert resolve(record) == {
        "title": "how to write <b>",
        "selftext": "&nbsp;",
        "url": "https://example.org/?a=1&b=2",
        "poll_data": {"options": [{"text": "R&D"}]},
    }


def test_an_address_is_no_text_and_tells_nothing() -> None:
    record = {"title": "R&amp;D", "url": "https://example.org/?a=1&copy=2&lt;=3"}
    assert resolve(record) == {**record, "title": "R&D"}


def test_entities_of_comments_in_dumps_are_resolved() -> None:
    usual = {"parent_id": "t3_p", "link_id": "t3_p", "created_utc": 5, "score": 1, "author": "x"}
    bodies = {"c1": "a &lt; b", "c2": "a < b &lt;", "c3": "Q&amp;A", "c4": "Q&A &amp; more"}
    things = [{"kind": "t1", "data": {**usual, "id": k, "body": v}} for k, v in bodies.items()]
    (table,) = parse.rows([line(things)], "dumps", LINKS)
    assert table["text"].to_pylist() == ["a < b", "a < b &lt;", "Q&A", "Q&A &amp; more"]


def line(things: list[Any]) -> bytes:
    listing = {"kind": "Listing", "data": {"children": things, "after": None}}
    return rawlog.encode(Envelope(None, Request("dump/RS.zst", {"offset": 1}), 200, listing))
