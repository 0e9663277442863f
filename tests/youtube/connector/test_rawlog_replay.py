"""A state made again from raw data is the one that the crawl had, whatever the answers hold."""

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kb.core.config.profile import load_profile
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import Envelope, Request
from kb.store.state.frontier import Frontier
from kb.youtube.connector import rawlog_replay
from kb.youtube.connector.reduce import RAW_TRANSCRIPTS, RAW_VIDEOS, Reducer, nothing

ids = st.sampled_from(["v1", "v2", "v3", "é", ""])
odd = st.none() | st.integers() | st.lists(st.just("x"), max_size=1) | st.just({"a": 1})
outcomes = st.fixed_dictionaries(
    {},
    optional={
        "video_id": ids | st.integers(),
        "outcome": st.sampled_from(["ok", "none", "failed", "disabled", "", None]),
        "reason": st.text(max_size=3) | st.none(),
        "cues": st.just([[0.0, 1.0, "words"]]) | odd,
    },
)
asked = st.fixed_dictionaries(
    {}, optional={"id": st.lists(ids, max_size=3).map(",".join) | st.lists(ids, max_size=2)}
)


class Undo(Exception):
    """Takes back what an example did."""


@pytest.fixture(scope="module")
def frontier(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Frontier]:
    made = Frontier(tmp_path_factory.mktemp("state") / "youtube.sqlite")
    yield made
    made.close()


def effect(frontier: Frontier, way: Callable[[], Any]) -> Any:
    with pytest.raises(Undo), frontier.transaction():
        frontier.add("transcripts", ["v3", "v2"])
        frontier.add("refresh", ["v2"])
        way()
        found = {
            row[:2]: row[2:]
            for row in frontier._db.execute(
                "SELECT kind, key, status, reason,"
                " row_number() OVER (PARTITION BY kind ORDER BY seq) FROM items"
            ).fetchall()
        }
        raise Undo
    return found


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.sampled_from([RAW_TRANSCRIPTS, RAW_VIDEOS]),
    st.lists(st.tuples(asked, outcomes | odd, st.sampled_from([200, 404])), max_size=5),
    st.booleans(),
    st.sampled_from([1, 2, 1000]),
)
def test_what_is_taken_in_is_as_one_by_one(
    frontier: Frontier,
    kind: str,
    answers: list[tuple[Any, Any, int]],
    escaped: bool,
    at_once: int,
) -> None:
    reducer = Reducer(load_profile("minecraft").section("youtube"), nothing, bool, ())
    lines = [
        rawlog.encode(Envelope("2026-01-01T00:00:00Z", Request("e", params), status, response))
        for params, response, status in answers
    ]
    if escaped:
        lines = [json.dumps(json.loads(line)).encode() for line in lines]

    def one_by_one() -> None:
        for line in lines:
            reducer(frontier, kind, rawlog.decode(line))

    want = effect(frontier, one_by_one)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rawlog_replay, "_AT_ONCE", at_once)
        assert (
            effect(frontier, lambda: rawlog_replay.take_in(reducer, frontier, kind, lines)) == want
        )
