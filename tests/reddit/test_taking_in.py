"""A state made again from raw data is the one that the crawl had, whatever the answers hold."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kb.reddit import parse, reduce, replay
from kb.store import rawlog
from kb.store.frontier import Frontier
from kb.store.rawlog import Envelope, Request
from tests.reddit.raw import post
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


class Undo(Exception):
    """Takes back what an example did."""


@pytest.fixture(scope="module")
def frontier(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Frontier]:
    made = Frontier(tmp_path_factory.mktemp("state") / "reddit.sqlite", payloads=reduce.PAYLOADS)
    yield made
    made.close()


def effect(frontier: Frontier, way: Callable[[], None]) -> Any:
    """What is in the frontier afterwards, or what was raised."""
    with pytest.raises(Undo), frontier.transaction():
        frontier.add("more", [("c2", reduce.StubItem("p1")), ("c1", reduce.StubItem("p1"))])
        try:
            way()
            found: Any = {kind: list(frontier.items(kind)) for kind in frontier.kinds()}
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            found = type(error)
        raise Undo
    return found


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.lists(answers(), min_size=1, max_size=3),
    st.sampled_from(["as ours", "with spaces", "escaped"]),
)
def test_what_is_taken_in_is_as_one_by_one(
    frontier: Frontier, made: list[tuple[str, Envelope]], how: str
) -> None:
    kind = made[0][0]
    lines = [spelled(rawlog.encode(envelope), how) for other, envelope in made if other == kind]

    def one_by_one() -> None:
        for line in lines:
            reduce.reduce(frontier, kind, rawlog.decode(line))

    want = effect(frontier, one_by_one)
    assert effect(frontier, lambda: replay.take_in(frontier, kind, lines)) == want


def test_a_post_with_its_stubs(frontier: Frontier, tmp_path: Path) -> None:
    """The usual answer, decoded by types."""
    below = {"kind": "more", "data": {"id": "c7", "children": ["c7", "c8"], "parent_id": "t1_c1"}}
    deeper = {"kind": "more", "data": {"id": "_", "children": [], "parent_id": "t1_c1"}}
    replies = {"kind": "Listing", "data": {"children": [below, deeper]}}
    comment = {"kind": "t1", "data": {"id": "c1", "body": "words", "replies": replies}}
    page = [{"kind": "Listing", "data": {"children": [comment]}}]
    asked = rawlog.Request("comments/p1", {"article": "p1"})
    line = rawlog.encode(Envelope("2026-01-01T00:00:00Z", asked, 200, page))
    found = effect(frontier, lambda: replay.take_in(frontier, "comments", [line]))
    assert [key for key, *_ in found["more"]] == ["c2", "c1", "c7", "c8"]
    assert [row[:2] for row in found["tree"]] == [("p1", "done")]
    assert [row[:2] for row in found["thread"]] == [("p1/c1", "todo")]
