"""Records of any year become rows: values, types of posts, HTML entities."""

import html
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.errors import DamagedData
from kb.reddit.parse import answers as parse
from kb.reddit.parse.records import (
    is_crosspost,
    link_classifier,
    poll_options,
    post_type,
    resolve,
    unescaped,
    was_never_escaped,
)
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from tests.reddit.cassettes import Row, read, read_rows

THINGS = {  # what is in each cassette: state and kind → how many different ones
    "TestComment.test_attributes": {"there t1": 1},
    "TestComment.test_invalid": {"missing t1": 1},
    "TestComment.test_parent__chain": {"there t1": 32, "there t3": 1},
    "TestComment.test_refresh__deleted_comment": {"there t1": 1, "there t3": 1},
    "TestComment.test_refresh__with_reply_sort_and_limit": {
        "there t1": 4,
        "there t3": 1,
        "stub t1": 6,
    },
    "TestCommentForest.test_replace__all": {
        "there t1": 541,
        "there t3": 1,
        "stub t1": 24,
        "missing t1": 2,
    },
    "TestCommentForest.test_replace__on_direct_comment": {"there t1": 146, "there t3": 1},
    "TestListingGenerator.test_exhaust_items": {"there t1": 990, "there t3": 11},
    "TestReddit.test_info": {"there t1": 100, "there t3": 97, "missing t3": 3},
    "TestReddit.test_info_url": {"there t3": 25},
    "TestRedditorListings.test_overview__top": {"there t1": 100},
    "TestSubmission.test_comments": {"there t1": 2, "there t3": 1},
    "TestSubmission.test_crosspost": {"there t3": 2},
    "TestSubmission.test_delete": {"there t1": 4, "there t3": 1},
    "TestSubmission.test_duplicates": {"there t3": 4},
    "TestSubmission.test_edit__experimental": {"there t3": 1},
    "TestSubmission.test_hide_multiple_in_batches": {"there t3": 100},
    "TestSubreddit.test_search": {"there t3": 6},
    "TestSubreddit.test_submit__nsfw": {"there t3": 1},
    "TestSubreddit.test_submit__url_selftext": {"there t3": 1},
    "TestSubreddit.test_submit_poll": {"there t3": 1},
    "TestSubredditListings.test_new": {"there t3": 100},
    "TestSubredditListings.test_top": {"there t3": 100},
    "TestSubredditStreams.test_comments__with_pause": {"there t1": 17},
}


def one(found: list[Row], name: str) -> Row:
    return next(row for row in found if row["fullname"] == name)


@pytest.mark.parametrize("name", THINGS)
def test_every_thing_of_every_answer_is_a_row_without_a_problem(
    rows: Callable[[str], list[Row]], name: str
) -> None:
    found = rows(name)
    different = {
        (row["state"], row["fullname"]) for row in found if not row["fullname"].startswith("t5_")
    }
    assert Counter(f"{state} {full[:2]}" for state, full in different) == THINGS[name]
    assert [row["problems"] for row in found if row["problems"]] == []
    assert all(row["post_id"] for row in found if row["state"] != "missing")
    for row in found:
        if row["state"] == "there":
            assert row["created_utc"].year > 2004
            assert isinstance(row["score"], int)


def test_names_that_info_leaves_out_are_missing(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestReddit.test_info")
    assert {
        row["fullname"]
        for row in found
        if row["state"] == "missing" and row["fullname"][:2] != "t5"
    } == {"t3_5dec66", "t3_5dec67", "t3_5dec68"}
    assert Counter(row.get("gone") for row in found if row["state"] == "there") == {
        None: 180,
        "deleted": 9,
        "removed": 8,
    }
    assert rows("TestComment.test_invalid")[0]["fullname"] == "t1_0"


def test_types_of_a_page_of_today(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestSubmission.test_hide_multiple_in_batches")
    assert Counter(row["type"] for row in found) == {
        "image": 50,
        "video": 25,
        "gallery": 14,
        "text": 6,
        "link": 5,
    }
    assert Counter(row["link_kind"] for row in found) == {
        "image": 50,
        "video": 25,
        "general": 5,
        None: 20,
    }
    assert all(0 <= row["upvote_ratio"] <= 1 for row in found)
    assert all(row["source_url"] for row in found if row["type"] != "text")


def test_a_poll(rows: Callable[[str], list[Row]]) -> None:
    row = one(rows("TestSubreddit.test_submit_poll"), "t3_ga3hiq")
    assert (row["type"], row["poll_options"], row["source_url"]) == (
        "poll",
        ["Yes", "No", "3", "4", "5", "6"],
        None,
    )
    assert (row["title"], row["created_utc"].year, row["upvote_ratio"]) == ("Test Poll", 2020, 1.0)


def test_a_crosspost_has_its_parents_type(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestSubmission.test_crosspost")
    parent, copy = one(found, "t3_6vx01b"), one(found, "t3_6vx8n0")
    assert (parent["is_crosspost"], copy["is_crosspost"]) == (False, True)
    assert parent["type"] == copy["type"] == "text"
    assert parent["text"] == "crossposting"
    assert one(rows("TestSubmission.test_crosspost__nsfw"), "t3_c27k7n")["over_18"] is True


def test_what_was_deleted_or_removed(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestSubmission.test_delete")
    assert {row["fullname"]: row["gone"] for row in found} == {
        "t3_4b1tfm": "deleted",
        "t1_d1616q2": "deleted",
        "t1_d1680wu": None,
        "t1_d1628v0": None,
        "t1_d162ara": None,
    }
    assert one(found, "t1_d1680wu")["parent_id"] == "t1_d1616q2"
    assert one(found, "t1_d1616q2")["author_hash"] is None
    row = one(rows("TestSubreddit.test_submit__url_selftext"), "t3_1kh35wk")
    assert (row["type"], row["link_kind"], row["gone"], row["gone_value"]) == (
        "link",
        "general",
        "removed",
        "reddit",
    )
    assert row["source_url"] == "https://praw.readthedocs.org/en/stable/"


def test_a_comment(rows: Callable[[str], list[Row]]) -> None:
    row = rows("TestComment.test_attributes")[0]
    assert (
        row["fullname"],
        row["post_id"],
        row["parent_id"],
        row["score"],
        row["created_utc"].timestamp(),
    ) == (
        "t1_cklhv0f",
        "2gmzqe",
        "t1_cklfmye",
        1,
        1411010034,
    )
    assert row["text"].startswith("Yes it does. That fix is also in the master branch")


def test_old_listings_lack_what_came_later(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestSubredditListings.test_new")
    assert {row["upvote_ratio"] for row in found} == {None}
    assert {(row["type"], row["over_18"]) for row in found} >= {("text", False)}


def test_no_name_is_left_of_a_recorded_answer(recorded: Path) -> None:
    from kb.reddit.parse.anonymize import Scrubber

    scrubber = Scrubber(b"k" * 64)
    for path in sorted((recorded / "reddit").glob("*.json")):
        for exchange in read(path):
            if exchange.status != 200 or not exchange.body.startswith(("{", "[")):
                continue
            names = _authors(json.loads(exchange.body))
            left = _authors(scrubber.scrub(json.loads(exchange.body)))
            assert not {name for name in names if len(name) > 3} & left, path.name


def _authors(value: Any) -> set[str]:
    """Names of people in an answer, by the fields that hold them; `[deleted]` is none."""
    found: set[str] = set()
    if isinstance(value, list):
        return found.union(*map(_authors, value)) if value else found
    if isinstance(value, dict):
        for name, inner in value.items():
            if (
                name in ("author", "link_author", "author_fullname")
                and isinstance(inner, str)
                and inner != "[deleted]"
            ):
                found.add(inner)
            else:
                found |= _authors(inner)
    return found


def test_a_raw_line_of_another_writer_may_hold_what_arrow_cannot(tmp_path: Path) -> None:
    line = (
        b'{"fetched_at":"2026-11-20T00:00:00Z","request":{"endpoint":"info",'
        b'"params":{"id":"t3_a"}},"status":200,"response":'
        b'{"kind":"Listing","data":{"children":[{"kind":"t3","data":{"id":"a",'
        b'"title":"half \\\\ud83d a face","selftext":"nul \\\\u0000"}}]}}}'
    ).replace(b"\\\\u", b"\\u")
    (found,) = read_rows("info", line)
    assert (found["title"], found["text"]) == ("half \ufffd a face", "nul \ufffd")
    with pytest.raises(DamagedData):
        read_rows("info", line.replace(b"half", b"h\xe4lf"))


CLASSIFY = link_classifier(load_profile("minecraft").section("reddit").links)


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("https://i.redd.it/abc.png", "image"),
        ("https://i.redd.it/abc", "image"),
        ("https://imgur.com/abc", "image"),
        ("https://imgur.com/a/abc", "image"),
        ("https://m.imgur.com/gallery/abc", "image"),
        ("https://i.imgur.com/abc.gif", "image"),
        ("https://preview.redd.it/abc.jpg?width=640&auto=webp", "image"),
        ("https://example.org/wiki/Creeper.JPG", "image"),
        ("https://i.imgur.com/abc.gifv", "video"),
        ("https://v.redd.it/abc", "video"),
        ("https://streamable.com/abc", "video"),
        ("https://gfycat.com/Abc", "video"),
        ("https://www.youtube.com/watch?v=abc", "video"),
        ("https://youtu.be/abc", "video"),
        ("https://m.youtube.com/shorts/abc", "video"),
        ("https://music.youtube.com/watch?v=abc", "video"),
        ("https://www.youtube-nocookie.com/embed/abc", "video"),
        ("https://youtube.com/clip/Ugkabc", "video"),
        ("https://example.org/film.mp4", "video"),
        ("https://www.youtube.com/@somebody", "general"),
        ("https://www.youtube.com/", "general"),
        ("https://youtu.be/", "general"),
        ("https://notimgur.com/abc", "general"),
        ("https://imgur.com.example.org/abc", "general"),
        ("https://example.org/a.b/c", "general"),
        ("https://example.org", "general"),
        ("http://[broken", "general"),
        ("", "general"),
        ("/r/Minecraft/wiki", "general"),
    ],
)
def test_addresses(address: str, kind: str) -> None:
    assert CLASSIFY(address) == kind


SELF = {
    "is_self": True,
    "permalink": "/r/M/comments/a/t/",
    "url": "https://www.reddit.com/r/M/comments/a/t/",
}
FILM = {"is_self": False, "is_video": True, "url": "https://v.redd.it/x"}


@pytest.mark.parametrize(
    ("post", "expected"),
    [
        (SELF, ("text", None, None)),
        ({**SELF, "is_self": None}, ("text", None, None)),
        ({"is_self": False, "url": None}, ("text", None, None)),
        ({**SELF, "poll_data": {"options": [{"text": "a"}]}}, ("poll", None, None)),
        (
            {"is_gallery": True, "url": "https://www.reddit.com/gallery/a"},
            ("gallery", None, "https://www.reddit.com/gallery/a"),
        ),
        (
            {"url": "https://www.reddit.com/gallery/a"},
            ("gallery", None, "https://www.reddit.com/gallery/a"),
        ),
        (FILM, ("video", "video", "https://v.redd.it/x")),
        (
            {"url": "https://i.redd.it/a.png", "post_hint": "link"},
            ("image", "image", "https://i.redd.it/a.png"),
        ),
        (
            {"url": "https://a.org/x", "url_overridden_by_dest": "https://i.redd.it/a.png"},
            ("image", "image", "https://i.redd.it/a.png"),
        ),
        ({"url": "https://notes.example/a"}, ("link", "general", "https://notes.example/a")),
        (
            {"url": "https://v.redd.it/y", "crosspost_parent_list": [FILM]},
            ("video", "video", "https://v.redd.it/x"),
        ),
        ({"url": "/r/M/comments/a/t/", "crosspost_parent_list": [SELF]}, ("text", None, None)),
        (
            {"url": "https://a.org/x", "crosspost_parent_list": []},
            ("link", "general", "https://a.org/x"),
        ),
        (
            {"url": "https://a.org/x", "crosspost_parent": "t3_gone"},
            ("link", "general", "https://a.org/x"),
        ),
        (
            {"url": "/gallery/gone", "crosspost_parent": "t3_gone"},
            ("gallery", None, "/gallery/gone"),
        ),
        ({"url": "/r/M/comments/gone/t/", "crosspost_parent": "t3_gone"}, ("text", None, None)),
        (
            {"url": "https://www.reddit.com/r/M/comments/b/t/"},
            ("link", "general", "https://www.reddit.com/r/M/comments/b/t/"),
        ),
    ],
)
def test_types(post: dict[str, Any], expected: tuple[str, str | None, str | None]) -> None:
    assert post_type(post, CLASSIFY) == expected


def test_crossposts_and_polls() -> None:
    assert is_crosspost({"crosspost_parent": "t3_a"})
    assert not is_crosspost({"crosspost_parent_list": []})
    assert poll_options({"poll_data": {"options": [{"text": "oak"}, {"text": "spruce"}, 3]}}) == [
        "oak",
        "spruce",
    ]
    assert poll_options({"crosspost_parent_list": [{"poll_data": {"options": []}}]}) == []
    assert poll_options(SELF) is None


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


@pytest.mark.parametrize(
    ("given", "parent"),
    [
        ({"parent_id": None}, "t3_p"),
        ({"parent_id": 44445998962}, "t1_kf200aa"),
        ({"parent_id": 44445998962.0}, "t1_kf200aa"),
        ({"parent_id": 35}, "t1_z"),
        *(({"parent_id": f"{key}"}, "t1_kf200aa") for key in (44445998962, 44445998962.0)),
        *(({"parent_id": key}, "t1_z") for key in ("35", " 35\n", "0035")),
        *(({"parent_id": odd}, None) for odd in (4.5, -1, 0, True, "", "kf200aa", [1])),
        *(({"parent_id": odd}, None) for odd in ("4.5", "-1", "0", "1e3", "٣٥", "9" * 30)),
        ({"parent_id": None, "link_id": None}, None),
        ({}, None),
    ],
)
def test_a_parent_of_null_is_the_post_and_a_number_is_a_comment(
    given: dict[str, Any], parent: str | None
) -> None:
    usual = {"id": "c", "link_id": "t3_p", "body": "b", "created_utc": 5, "score": 1, "author": "x"}
    (table,) = parse.rows([line([{"kind": "t1", "data": {**usual, **given}}])], "dumps", LINKS)
    assert table["parent_id"].to_pylist() == [parent]
    problems = [one["column"] for one in table["problems"].to_pylist()[0]]
    assert ("parent_id" in problems) == (parent is None)


def test_an_option_without_words_is_no_option() -> None:
    options = [{"text": None}, {"text": "oak &amp; ash"}, {"text": ""}, {}, {"text": 5}]
    data = {"id": "p", "title": "t", "poll_data": {"options": options}}
    (table,) = parse.rows([line([{"kind": "t3", "data": data}])], "dumps", LINKS)
    assert table["poll_options"].to_pylist() == [["oak & ash", "5"]]


def line(things: list[Any]) -> bytes:
    listing = {"kind": "Listing", "data": {"children": things, "after": None}}
    return rawlog.encode(Envelope(None, Request("dump/RS.zst", {"offset": 1}), 200, listing))
