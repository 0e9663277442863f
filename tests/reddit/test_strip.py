"""Purged ids leave raw answers, and a search of the bytes overlooks none of them."""

from __future__ import annotations

import json
import re

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.artifacts.purge_raw import matcher
from kb.core.errors import DamagedData
from kb.reddit.parse import tree
from kb.reddit.parse.remove_ids import crossposts_of, strip
from kb.reddit.purge import texts
from kb.store import rawlog
from kb.store.rawlog import Envelope, Request
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


@settings(max_examples=300, deadline=None)
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
        assert matcher(texts(keys))(line)
    if left is not None:
        names = {f"{one.kind}_{one.data.get('id')}" for one in tree.things(left.response)}
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


@pytest.mark.parametrize("name", ["t1_ab", "t3_ab"])
def test_a_short_id_within_another_word_is_no_key(name: str) -> None:
    holds = matcher(texts({name, "t1_abc"}))
    assert not holds(b'{"id":"abcd","link_id":"t3_xab","body":"cab, drab; xabc"}')
    for line in (
        b'{"id":"ab"}',
        b'"t3_ab"',
        b'"t1_x,t1_ab"',
        b'"abc"',
        b'"\\u0061b"',
        b'"abab","ab"',
    ):
        assert holds(line), line


def test_a_line_that_is_no_json_inside_is_damage() -> None:
    line = msgspec.json.encode(Envelope(None, Request("e", {}), 200, "x"))
    for broken in (line.replace(b'"x"', b'"\\ud800"'), line.replace(b'"x"', b'"\xff"')):
        with pytest.raises(DamagedData):
            rawlog.decode(broken)
