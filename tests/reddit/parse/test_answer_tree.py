"""Things in answers, and how comments hang together."""

from collections.abc import Callable
from typing import Any

import pytest

from kb.reddit.parse import answer_tree
from kb.reddit.parse.answer_tree import depths
from tests.reddit.cassettes import Row


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
