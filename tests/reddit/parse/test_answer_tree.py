"""Things in answers, and how comments hang together."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from kb.core.config.profile import load_profile
from kb.reddit.parse import answer_tree
from kb.reddit.parse import answers as parse
from kb.reddit.parse.answer_tree import depths
from kb.store.rawlog.rawlog import Envelope, Request, encode
from tests.reddit.cassettes import Exchange, read


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


Row = dict[str, Any]


LINKS = load_profile("minecraft").section("reddit").links


def _kind(exchange: Exchange) -> str:
    for part, kind in (
        ("api/info", "info"),
        ("morechildren", "morechildren"),
        ("/comments/", "comments"),
    ):
        if part in exchange.path:
            return kind if not exchange.path.startswith("/r/") else "listings"
    return "listings"


def read_rows(kind: str, line: bytes) -> list[Row]:
    """The rows of an answer but for the marks of what was read."""
    rows = [row for part in parse.rows([line], kind, LINKS) for row in part.to_pylist()]
    return [row for row in rows if row["state"] not in parse.MARKS]


@pytest.fixture
def rows(recorded: Path) -> Callable[[str], list[Row]]:
    """Rows of all answers of a cassette."""

    def of(name: str) -> list[Row]:
        found: list[Row] = []
        for exchange in read(recorded / "reddit" / f"{name}.json"):
            if exchange.status != 200 or "access_token" in exchange.path:
                continue
            kind, params = _kind(exchange), {**exchange.query, **exchange.form}
            if kind == "comments":
                params["article"] = exchange.path.split("/")[2]
            request, answer = Request(exchange.path, params), json.loads(exchange.body)
            found += read_rows(kind, encode(Envelope("2026-01-01T00:00:00Z", request, 200, answer)))
        return found

    return of


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
