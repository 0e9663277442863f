"""Answers become rows; how their comments hang together."""

import json
from collections.abc import Callable
from typing import Any
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.core.errors import DamagedData
from kb.reddit.parse import answer_tree
from kb.reddit.parse import answers as parse
from kb.reddit.parse.answer_tree import depths
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from tests.reddit.cassettes import Row
from tests.reddit.raw import comment, listing, post
from tests.reddit.strategies import params, response, things


@pytest.mark.parametrize(
    ("at", "since", "until", "expected"),
    [
        (5, None, None, False),
        (5, 5, 6, False),
        (5, 6, None, True),
        (5, None, 5, True),
        (5.5, 5, 5.5, True),
        (None, 6, 7, False),
        ("5", 6, 7, False),
    ],
)
def test_since_is_inside_and_until_is_not(at: Any, since: Any, until: Any, expected: bool) -> None:
    assert answer_tree.outside(at, since, until) is expected


def test_a_forest_is_whole_after_its_stubs(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestCommentForest.test_replace__all")
    known = {row["fullname"] for row in found if row["state"] != "stub"}
    assert {row["fullname"] for row in found if row["state"] == "stub"} - known == set()
    deep = depths(
        (row["fullname"][3:], row["parent_id"])
        for row in found
        if row["state"] == "there" and row["parent_id"]
    )
    assert (max(value for value in deep.values() if value is not None), None in deep.values()) == (
        11,
        False,
    )


def test_a_chain_read_from_the_bottom_up(rows: Callable[[str], list[Row]]) -> None:
    found = rows("TestComment.test_parent__chain")
    deep = depths((row["fullname"][3:], row["parent_id"]) for row in found if row["parent_id"])
    assert sorted(deep.values()) == list(range(32))


LINKS = load_profile("minecraft").section("reddit").links


def read(kind: str, *lines: bytes) -> list[dict[str, Any]]:
    """The rows of some lines."""
    return [row for part in parse.rows(lines, kind, LINKS) for row in part.to_pylist()]


def envelope(answer: Any, asked: dict[str, Any] | None = None, status: int = 200) -> bytes:
    return rawlog.encode(
        Envelope("2026-01-01T00:00:00Z", Request("e", asked or {}), status, answer)
    )


@settings(max_examples=80, deadline=None)
@given(
    st.sampled_from(parse.KINDS),
    st.lists(things(), max_size=4),
    params,
    st.sampled_from(["2026-11-20T12:00:00Z", None, "odd"]),
)
def test_every_thing_of_any_answer_has_a_row(
    kind: str, children: list[Any], asked: dict[str, Any], at: str | None
) -> None:
    answer = response(kind, children)
    line = json.dumps(
        {"fetched_at": at, "request": {"endpoint": "e", "params": asked}}
        | {"status": 200, "response": answer}
    ).encode()
    rows = read(kind, line)
    shown = [
        f"{thing.kind}_{thing.data['id']}"
        for thing in answer_tree.things(answer)
        if thing.kind != "more" and isinstance(thing.data.get("id"), str) and thing.data["id"]
    ]
    names = [row["fullname"] for row in rows if row["state"] == "there"]
    if kind == "listings" and "since" in asked:  # what lies outside of the span is left out
        assert set(names) <= set(shown)
    else:
        assert names == shown
    for row in rows:
        problems = {one["column"] for one in row["problems"]}
        assert not {name for name in problems - {"state", "body"} if row[name] is not None}


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(parse.KINDS), st.lists(things(), max_size=4), params)
def test_what_is_not_decoded_is_in_no_row(
    kind: str, children: list[Any], asked: dict[str, Any]
) -> None:
    line = envelope(response(kind, children), asked)
    with mock.patch.object(parse, "_DECODER", parse._WHOLE):
        whole = read(kind, line)
    assert read(kind, line) == whole


def test_a_line_that_is_no_envelope_is_damage() -> None:
    with pytest.raises(DamagedData):
        read("info", b"{")


def test_lone_surrogates_become_replacement_characters() -> None:
    line = envelope(listing(comment("c1", body="x"))).replace(b'"x"', b'"a\\ud800"')
    assert [row["text"] for row in read("info", line)] == ["a\N{REPLACEMENT CHARACTER}"]


@pytest.mark.parametrize(
    ("kind", "asked", "status", "missing"),
    [
        ("info", {"id": "t3_a,t1_b", "posts": ["a", "p"]}, 200, [("t3_a", "a"), ("t1_b", "p")]),
        ("info", {"id": "t1_b"}, 200, [("t1_b", "")]),
        (
            "morechildren",
            {"link_id": "t3_p", "children": "b,c"},
            200,
            [("t1_b", "p"), ("t1_c", "p")],
        ),
        ("comments", {"article": "p"}, 404, [("t3_p", "p")]),
        ("comments", {"article": "p", "comment": "c"}, 404, []),
        ("comments", {"article": "p"}, 403, []),
    ],
)
def test_what_was_asked_for_and_did_not_come_is_missing(
    kind: str, asked: dict[str, Any], status: int, missing: list[tuple[str, str]]
) -> None:
    rows = read(kind, envelope(listing() if status == 200 else None, asked, status))
    found = [(row["fullname"], row["post_id"]) for row in rows if row["state"] == "missing"]
    assert found == missing


def test_what_came_is_not_missing() -> None:
    line = envelope(listing(post("a")), {"id": "t3_a,t1_b"})
    assert [(row["fullname"], row["state"]) for row in read("info", line)] == [
        ("t3_a", "there"),
        ("t1_b", "missing"),
    ]


@pytest.mark.parametrize(
    ("field", "value", "column", "reason"),
    [
        ("body", None, "body", "absent"),
        ("body", 5, "body", "malformed"),
        ("parent_id", "c5", "parent_id", "malformed"),
        ("parent_id", "LEFT OUT", "parent_id", "absent"),
        ("score", "many", "score", "malformed"),
        ("score", 2**70, "score", "malformed"),
        ("created_utc", -1, "created_utc", "malformed"),
        ("id", "", "state", "malformed"),
    ],
)
def test_a_value_that_cannot_be_read_is_null_and_named(
    field: str, value: Any, column: str, reason: str
) -> None:
    (row,) = read("info", envelope(listing(comment("c1", **{field: value}))))
    assert [(one["column"], one["reason"]) for one in row["problems"]] == [(column, reason)]


@pytest.mark.parametrize(("field", "value"), [("score", "7"), ("score", 7.9), ("score", 7)])
def test_numbers_of_any_year(field: str, value: Any) -> None:
    (row,) = read("dumps", envelope(listing(comment("c1", **{field: value}))))
    assert (row[field], row["problems"]) == (7, [])
