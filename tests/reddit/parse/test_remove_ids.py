"""Purged ids leave raw answers, and a search of the bytes overlooks none of them."""

import json
import re
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.artifacts.purge_raw import Matcher
from kb.core.errors import DamagedData
from kb.reddit.parse import answer_tree
from kb.reddit.parse.remove_ids import crossposts_of, strip
from kb.reddit.purge import texts
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from tests.reddit.raw import comment, listing, post
from tests.reddit.strategies import NAMES, answers


def spelled(line: bytes, how: str) -> bytes:
    """The same JSON as others write it."""
    if how == "as ours":
        return line
    value = json.loads(line)
    if how == "with spaces":
        return json.dumps(value, indent=1).replace("\n", " ").encode()
    text = json.dumps(value, separators=(",", ":"))
    # Of an id only: the digits of another escape may read like one.
    text = re.sub(r'(?<=["_,])c1', r"\\u0063\\u0031", text)
    return re.sub(r'(?<=["_,])p1', r"p\\u0031", text).encode()


@settings(max_examples=100, deadline=None)
@given(
    answers(),
    st.sets(st.sampled_from(NAMES), max_size=3),
    st.sampled_from(["as ours", "with spaces", "escaped"]),
)
def test_what_a_purge_changes_is_found_by_the_search(
    made: tuple[str, Envelope], keys: set[str], how: str
) -> None:
    kind, envelope = made
    line = spelled(rawlog.encode(envelope), how)
    decoded = rawlog.decode(line)
    left = strip(kind, decoded, keys)
    if left is not decoded or crossposts_of(decoded.response, keys):
        assert Matcher(texts(keys))(line)
    if left is not None:
        names = {f"{one.kind}_{one.data.get('id')}" for one in answer_tree.things(left.response)}
        assert not names & keys
        assert strip(kind, left, keys) is left, "a second purge changes nothing"


def test_what_holds_no_key_stays_as_it_was() -> None:
    stays = comment("stays", body="1", link_id="t3_other")
    envelope = Envelope(None, Request("e", {}), 200, listing(comment("goes"), stays))
    left = strip("info", envelope, {"t1_goes"})
    assert left is not None
    assert left.response["data"]["children"] == [stays]
    assert strip("info", envelope, {"t1_elsewhere"}) is envelope


def test_the_next_page_behind_a_key_stands_behind_what_is_left() -> None:
    answer = listing(post("c2", name="t3_c2", crosspost_parent="t3_p1"), after="t3_p1")
    assert crossposts_of(answer, {"t3_p1"}) == {"c2"}
    left = strip("listings", Envelope(None, Request("e", {}), 200, answer), {"t3_p1"})
    assert left is not None
    assert left.response["data"]["after"] == "t3_c2"


def test_a_line_that_is_no_json_inside_is_damage() -> None:
    line = msgspec.json.encode(Envelope(None, Request("e", {}), 200, "x"))
    for broken in (line.replace(b'"x"', b'"\\ud800"'), line.replace(b'"x"', b'"\xff"')):
        with pytest.raises(DamagedData):
            rawlog.decode(broken)


def thing(kind: str, key: str, **fields: Any) -> dict[str, Any]:
    return {"kind": kind, "data": {"id": key, "name": f"{kind}_{key}", **fields}}


COMMENT = thing(
    "t1", "c", link_id="t3_p", replies=listing(thing("t1", "d", link_id="t3_p", replies=""))
)


SHARED = thing(
    "t3",
    "x",
    crosspost_parent="t3_p",
    crosspost_parent_list=[{"id": "p", "title": "t"}],
    url="/r/M/comments/p/title/",
)


@pytest.mark.parametrize(
    ("kind", "params", "answer", "keys", "expected"),
    [
        (
            "listings",
            {"after": "t3_p"},
            listing(thing("t3", "p"), thing("t3", "q"), after="t3_p"),
            {"t3_p"},
            ({"after": ""}, listing(thing("t3", "q"), after="t3_q")),
        ),
        (
            "listings",
            {},
            listing(SHARED),
            {"t3_p"},
            ({}, listing(thing("t3", "x", crosspost_parent="t3_p", crosspost_parent_list=[]))),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("t3", "p")), listing(COMMENT)],
            {"t3_p"},
            None,
        ),
        (
            "comments",
            {"article": "p", "comment": "c"},
            [listing(thing("t3", "p")), listing(COMMENT)],
            {"t1_c"},
            (
                {"article": "p"},
                [listing(thing("t3", "p")), listing(thing("t1", "d", link_id="t3_p", replies=""))],
            ),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(COMMENT)],
            {"t1_d"},
            ({"article": "p"}, [listing(thing("t1", "c", link_id="t3_p", replies=listing()))]),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("more", "a", children=["a", "b"], parent_id="t3_p"))],
            {"t1_a"},
            (
                {"article": "p"},
                [
                    listing(
                        {
                            "kind": "more",
                            "data": {
                                "id": "b",
                                "name": "t1_b",
                                "children": ["b"],
                                "parent_id": "t3_p",
                            },
                        }
                    )
                ],
            ),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("more", "a", children=["a"], parent_id="t3_p"))],
            {"t1_a"},
            ({"article": "p"}, [listing()]),
        ),
        ("comments", {"article": "p"}, None, {"t3_p"}, None),
        (
            "morechildren",
            {"link_id": "t3_p", "children": "c,e"},
            {"json": {"errors": [], "data": {"things": [COMMENT]}}},
            {"t1_c"},
            (
                {"link_id": "t3_p", "children": "e"},
                {
                    "json": {
                        "errors": [],
                        "data": {"things": [thing("t1", "d", link_id="t3_p", replies="")]},
                    }
                },
            ),
        ),
        (
            "morechildren",
            {"link_id": "t3_p", "children": "c"},
            {"json": {"data": {"things": [COMMENT]}}},
            {"t3_p"},
            None,
        ),
        (
            "info",
            {"id": "t3_p,t1_c,t1_z", "posts": ["p", "p", "q"]},
            listing(thing("t3", "p"), COMMENT),
            {"t3_p"},
            ({"id": "t1_z", "posts": ["q"]}, listing()),
        ),
        ("info", {"id": "t3_p"}, listing(thing("t3", "p")), {"t3_p"}, None),
        ("dumps", {}, listing(thing("t3", "p"), thing("t1", "c", link_id="t3_p")), {"t3_p"}, None),
    ],
)
def test_what_strip_leaves(
    kind: str, params: dict[str, Any], answer: Any, keys: set[str], expected: Any
) -> None:
    left = strip(kind, Envelope("2026-01-01T00:00:00Z", Request(kind, params), 200, answer), keys)
    assert (None if left is None else (left.request.params, left.response)) == expected


def test_an_envelope_without_the_keys_is_the_same_object() -> None:
    envelope = Envelope(
        None,
        Request("comments/p", {"article": "p"}),
        200,
        [listing(thing("t3", "p")), listing(COMMENT)],
    )
    assert strip("comments", envelope, {"t3_other", "t1_other"}) is envelope
