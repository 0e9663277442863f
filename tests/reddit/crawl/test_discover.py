"""A crawl of a span of time, and what a later one with another span or none makes of it."""

from datetime import UTC, datetime
from typing import Any

import pytest

from kb.core.errors import LimitReached
from kb.reddit.parse import answers as parse
from kb.store.rawlog.rawlog import Envelope, Request, encode
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.raw import listing, post
from tests.reddit.work import Work


@pytest.fixture
def few(tmp_path: Any) -> Any:
    with Sandbox(small_world(130, width=12, depth=12), services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path, listings=("new", "hot"), search=())


def made(work: Work) -> list[float]:
    return sorted(post["created_utc"] for post in work.world.posts.values())


def moment(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)


def sorted_posts(work: Work) -> set[str]:
    work.filter()
    kept = {row["post_id"] for row in work.table("clean", "reddit", "posts")}
    return kept | {
        row["key"][3:]
        for row in work.table("clean", "reddit", "rejected")
        if row["key"].startswith("t3_")
    }


def test_what_lies_outside_is_left_out_until_a_crawl_reads_it(few: Work) -> None:
    times = made(few)
    within = {
        key
        for key, post in few.world.posts.items()
        if times[100] <= post["created_utc"] < times[105]
    }
    summary = few.crawl(moment(times[100]), moment(times[105]))
    assert (summary["crawled"], summary["missing"], summary["failed"], summary["pending"]) == (
        5,
        0,
        0,
        0,
    )
    assert summary["outside"] == summary["posts"] - 5 > 0
    assert sorted_posts(few) == within
    before = len(few.sandbox.ledger)
    assert few.crawl(moment(times[100]), moment(times[105]))["requests"] == 0
    assert len(few.sandbox.ledger) == before, "the same span is finished"
    assert few.crawl(moment(times[95]), moment(times[100]))["crawled"] == 5
    assert few.crawl()["outside"] == 0
    assert sorted_posts(few) == few.world.posts.keys(), (
        "the rest of the listing as well, which ended at --since"
    )
    comments = {row["comment_id"] for row in few.table("clean", "reddit", "comments")}
    comments |= {row["key"][3:] for row in few.table("clean", "reddit", "rejected")}
    assert few.world.comments.keys() <= comments
    assert few.filter()["pending"] == 0


def test_a_new_round_reads_the_rest_of_a_listing_that_a_span_ended(few: Work) -> None:
    few.crawl(moment(made(few)[120]))
    few.crawl(again=True)
    few.crawl()
    assert sorted_posts(few) == few.world.posts.keys()


def test_limit_counts_what_lies_inside(few: Work) -> None:
    times = made(few)
    with pytest.raises(LimitReached):
        few.crawl(moment(times[100]), moment(times[105]), limit=4)
    assert few.crawl(moment(times[100]), moment(times[105]), limit=1)["crawled"] == 1, (
        "and the end of it is no limit"
    )


def test_a_post_outside_whose_page_is_shut_is_counted(few: Work) -> None:
    oldest = min(few.world.posts, key=lambda key: few.world.posts[key]["created_utc"])
    few.crawl(moment(made(few)[1]))
    few.sandbox.faults.add(
        f"^/comments/{oldest}/", status=403, body={"message": "no", "error": 403}, times=None
    )
    few.crawl()
    summary = few.filter()
    assert (summary["failed"], summary["pending"]) == (1, 0)
    assert few.table("clean", "reddit", "failed") == [{"key": f"t3_{oldest}", "reason": "403"}]


def test_a_listing_of_a_span_holds_rows_of_that_span_alone(whole: Work) -> None:
    answer = listing(
        post("early", created_utc=10.0),
        post("good", created_utc=20.0),
        post("late", created_utc=30.0),
        post("odd", created_utc=None),
    )
    line = encode(
        Envelope(
            "2026-01-01T00:00:00Z",
            Request("r/M/new", {"limit": 100, "since": 20.0, "until": 30.0}),
            200,
            answer,
        )
    )
    links = whole.run().profile.reddit.links
    rows = [row for part in parse.rows([line], "listings", links) for row in part.to_pylist()]
    assert [row["fullname"] for row in rows] == ["t3_good", "t3_odd"]
