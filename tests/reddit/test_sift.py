"""A purge decodes the things that may hold a key, and takes out as much as by decoding all."""

from __future__ import annotations

import json
import re

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.errors import DamagedData
from kb.reddit import parse, tree
from kb.reddit.crossposts import repeats
from kb.reddit.purge import holding
from kb.reddit.sift import Sift
from kb.reddit.strip import strip
from kb.store import rawlog
from kb.store.rawlog import Envelope, Request
from tests.reddit.raw import comment, listing, post
from tests.reddit.test_plain import params, response, things

NAMES = [*(f"t1_c{number}" for number in range(10)), "t3_p1", "t3_c1", "t3_7", "t1_3", "t3_"]
crossposts = st.sampled_from(
    [{"crosspost_parent": "t3_p1"}, {"crosspost_parent_list": [{"id": 7}]}]
)


@st.composite
def answers(draw: st.DrawFn) -> tuple[str, Envelope]:
    kind = draw(st.sampled_from(parse.KINDS))
    children = draw(st.lists(things(), max_size=4))
    if draw(st.booleans()):
        children.append(post("c2", **draw(crossposts)))
    answer = response(kind, children)
    if isinstance(answer, dict) and "data" in answer:
        answer["data"]["after"] = draw(st.sampled_from([None, *NAMES]))
    return kind, Envelope(None, Request("comments/p1", draw(params)), 200, answer)


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
def test_as_much_goes_as_by_decoding_everything(
    made: tuple[str, Envelope], keys: set[str], how: str
) -> None:
    kind, envelope = made
    line = spelled(rawlog.encode(envelope), how)
    whole = rawlog.decode(line)
    want = strip(kind, whole, keys)
    posts = [thing.data for thing in tree.things(whole.response) if thing.kind == tree.POST]
    shown = {str(data.get("id")) for data in posts if repeats(data, keys)}
    if want is not whole or shown:
        assert holding(keys)(line), "it would not even be read"
    sift, raw = Sift(), rawlog.undecoded(line)
    left = sift(kind, raw, keys)
    assert (left is raw, left is None) == (want is whole, want is None)
    if left is not None and want is not None:
        assert msgspec.json.decode(rawlog.encode(left)) == msgspec.to_builtins(want)
    assert shown <= sift.crossposts


def test_what_holds_no_key_stays_as_it_was_written() -> None:
    odd = b'{"kind":"t1","data":{ "id":"stays","body":"1","score":1e2,"link_id":"t3_other"}}'
    gone = msgspec.json.encode(comment("goes"))
    answer = msgspec.json.encode(listing()).replace(b"[]", b"[%b,%b]" % (gone, odd))
    line = msgspec.json.encode(Envelope(None, Request("e", {}), 200, msgspec.Raw(answer)))
    left = Sift()("info", rawlog.undecoded(line), {"t1_goes"})
    assert left is not None
    assert b"[%b]" % odd in rawlog.encode(left)


def test_a_crosspost_is_noted_where_the_next_page_stands_behind_a_key() -> None:
    answer = listing(post("c2", name="t3_c2", crosspost_parent="t3_p1"), after="t3_p1")
    line = rawlog.encode(Envelope(None, Request("e", {}), 200, answer))
    sift, raw = Sift(), rawlog.undecoded(line)
    left = sift("listings", raw, {"t3_p1"})
    assert left is not None
    assert left.response["data"]["after"] == "t3_c2"
    assert sift.crossposts == {"c2"}


@pytest.mark.parametrize("name", ["t1_ab", "t3_ab"])
def test_a_short_id_within_another_word_is_no_key(name: str) -> None:
    holds = holding({name, "t1_abc"})
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


def test_a_line_that_is_no_json_inside_is_named() -> None:
    line = b'{"fetched_at":null,"request":{"endpoint":"e","params":{}},"status":200,"response":'
    line += b'{"kind":"Listing","data":{"children":[{"kind":"t1","data":{"id":"\\ud800"}}]}}}'
    with pytest.raises(DamagedData, match="no envelope"):
        Sift()("info", rawlog.undecoded(line), {"t1_a"})
