"""Hypothesis strategies for raw answers of Reddit whose fields hold anything."""

from typing import Any

from hypothesis import strategies as st

from kb.reddit.parse import answers as parse
from kb.store.rawlog.rawlog import Envelope, Request
from tests.reddit.raw import post

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=4,
)
texts = st.sampled_from(
    ["hi &amp; you", "[deleted]", "[removed]", "a\0b", "\ud800", "&#91;deleted]"]
)
bodies = st.text("ab &;\n♪", max_size=9) | texts
numbers = st.integers(-5, 10**10) | st.sampled_from(
    [2**62, 2**70, 1.5, "7", True, None, -1, 10**12]
)
COMMENT = {
    "id": st.sampled_from(["c1", "c2", "c3", "c4", "", None, 7]),
    "link_id": st.just("t3_p1") | anything,
    "parent_id": st.sampled_from(["t3_p1", "t1_c0", "x", 5, None]),
    "body": bodies | anything,
    "score": numbers | anything,
    "created_utc": st.integers(0, 2 * 10**9) | numbers,
}
MORE = {
    "author": st.sampled_from(["a" * 32, "", "[deleted]", None, 5]),
    "removed_by_category": st.sampled_from([None, "", "deleted", "moderator", 3]),
    "is_robot_indexable": st.booleans() | st.none(),
    "selftext": bodies | st.none(),
    "title": bodies | st.none(),
    "retrieved_on": numbers,
    "retrieved_utc": numbers,
    "brand_new": anything,
    "num_comments": numbers,
    "over_18": anything,
    "url": bodies,
    "is_self": st.booleans(),
    "upvote_ratio": numbers,
    "poll_data": anything,
    "crosspost_parent_list": anything,
    "children": st.lists(st.sampled_from(["c8", "c9", 3]), max_size=2) | anything,
}
whole = {"id": "c1", "link_id": "t3_p1", "parent_id": "t3_p1", "body": "x", "created_utc": 5}


@st.composite
def records(draw: st.DrawFn) -> dict[str, Any]:
    """A comment as it should be, of which a few fields are anything."""
    changed = draw(st.lists(st.sampled_from([*COMMENT, *MORE]), max_size=4, unique=True))
    fields = COMMENT | MORE
    record = whole | {"score": 3} | {name: draw(fields[name]) for name in changed}
    gone = draw(st.sampled_from([None] * 12 + [*whole]))
    return {name: value for name, value in record.items() if name != gone}


@st.composite
def things(draw: st.DrawFn, depth: int = 2) -> Any:
    odd = draw(st.integers(0, 15))
    kind = "t5" if odd == 15 else draw(st.sampled_from(["t1", "t1", "t1", "t3", "more"]))
    data = None if odd == 14 else draw(records())
    if data and depth and draw(st.booleans()):
        below = st.lists(things(depth=depth - 1), max_size=2).map(listing)
        data["replies"] = draw(anything if odd == 13 else below | st.just(""))
    return {"kind": kind, "data": data}


def listing(children: Any) -> dict[str, Any]:
    return {"kind": "Listing", "data": {"after": None, "children": children}}


def response(kind: str, children: list[Any]) -> Any:
    if kind == "morechildren":
        return {"json": {"errors": [], "data": {"things": children}}}
    if kind == "comments":
        return [listing(children[:1]), listing(children[1:])]
    return listing(children)


params = st.fixed_dictionaries(
    {},
    optional={
        "article": st.just("p1"),
        "comment": st.just("c1"),
        "link_id": st.just("t3_p1"),
        "children": st.just("c1,c2"),
        "id": st.just("t1_c1,t3_p1"),
        "posts": st.just(["p1"]),
        "since": st.just(100.0),
        "offset": st.just(7),
    },
)

NAMES = [*(f"t1_c{number}" for number in range(10)), "t3_p1", "t3_c1", "t3_7", "t1_3", "t3_"]
crossposts = st.sampled_from(
    [{"crosspost_parent": "t3_p1"}, {"crosspost_parent_list": [{"id": 7}]}]
)


@st.composite
def answers(draw: st.DrawFn) -> tuple[str, Envelope]:
    """(raw kind, envelope)."""
    kind = draw(st.sampled_from(parse.KINDS))
    children = draw(st.lists(things(), max_size=4))
    if draw(st.booleans()):
        children.append(post("c2", **draw(crossposts)))
    answer = response(kind, children)
    if isinstance(answer, dict) and "data" in answer:
        answer["data"]["after"] = draw(st.sampled_from([None, *NAMES]))
    return kind, Envelope(None, Request("comments/p1", draw(params)), 200, answer)
