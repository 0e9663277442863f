"""Answers read as columns are the same rows as field by field, whatever they hold."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.profile import load_profile
from kb.reddit import heads, parse, plain

LINKS = load_profile("minecraft").section("reddit").links

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


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(parse.KINDS),
    st.lists(st.tuples(st.lists(things(), max_size=4), params), min_size=1, max_size=3),
    st.sampled_from([200, 200, 200, 404]),
    st.sampled_from(["2026-11-20T12:00:00Z", None, "odd"]),
)
def test_columns_are_the_rows_field_by_field(
    kind: str, answers: list[tuple[list[Any], Any]], status: int, at: str | None
) -> None:
    lines = [
        json.dumps(
            {
                "fetched_at": at,
                "request": {"endpoint": "dump/RC.zst", "params": asked},
                "status": status,
                "response": response(kind, children),
            }
        ).encode()
        for children, asked in answers
    ]
    reader = parse.RecordReader(kind, LINKS)
    careful = [row for line in lines for row in reader.envelope(line, marks=True)]
    found = [row for part in parse.rows(lines, kind, LINKS) for row in part.to_pylist()]
    assert found == parse.to_table(careful).to_pylist()
    # What refresh and purge go by is read out of them without the texts.
    kept = [
        {name: row[name] for name in heads.COLUMNS}
        for row in found
        if row["state"] in ("there", "missing")
    ]
    brief = [row for part in heads.rows(lines, kind, LINKS) for row in part.to_pylist()]
    assert brief == kept


def test_comments_as_they_should_be_take_the_quick_path() -> None:
    line = json.dumps(
        {
            "fetched_at": "2026-11-20T12:00:00Z",
            "request": {"endpoint": "comments/p1", "params": {"article": "p1"}},
            "status": 200,
            "response": response("comments", [{"kind": "t1", "data": whole | {"score": 3}}] * 2),
        }
    ).encode()
    page = plain.page(line, "comments")
    assert page is not None
    assert [plain.is_plain(thing.data, escaped=False) for thing in page.things] == [True, True]


@pytest.mark.parametrize("field", ["body", "parent_id", "created_utc"])
def test_a_comment_without_a_needed_field_is_looked_at_twice(field: str) -> None:
    record = plain.CommentFields(**{name: value for name, value in whole.items() if name != field})
    assert not plain.is_plain(record, escaped=False)
