"""What a crawl begins with, asks for, and takes from answers."""

from collections import Counter
from datetime import UTC, datetime
from typing import Any

import pytest

from kb.core.errors import LimitReached
from kb.core.progress import Progress
from kb.reddit.crawl.reduce import AGAIN
from kb.reddit.parse import answers as parse
from kb.sandbox.reddit.subreddit import CASES
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


SAYS_NO = {"json": {"errors": [["RATELIMIT", "you are doing that too much", "ratelimit"]]}}


class Said(Progress):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture
def paged(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """120 posts, of which a listing shows 40 in pages of ten; the newer sixty are not
    written yet.
    """
    monkeypatch.setattr("kb.sandbox.reddit.service.LISTED", 40)
    monkeypatch.setattr("kb.sandbox.reddit.service.PAGE", 10)
    world = small_world(120, width=3, depth=3)
    world.reddit.gone = {f"t3_{key}" for key in list(world.reddit.posts)[60:]}
    with Sandbox(world, services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path, listings=("new", "top"), spans=("all",), search=())


def listed(work: Work, name: str, since: int) -> int:
    return len(work.sandbox.ledger.requests(f"^/r/[A-Za-z]+/{name}", since=since))


def read(work: Work) -> set[str]:
    return {seen.path.split("/")[2] for seen in work.sandbox.ledger.requests("^/comments/")}


def test_a_finished_crawl_says_so(paged: Work) -> None:
    said = Said()
    paged.crawl(progress=said)
    assert said.lines == []
    paged.crawl(progress=said)
    assert said.lines == ["reddit: nothing left to read; --again starts a new round"]
    paged.crawl(progress=said, again=True)
    assert len(said.lines) == 1


def test_a_new_round_ends_by_time_where_there_is_an_order_by_time_and_nowhere_else(
    paged: Work,
) -> None:
    posts = list(paged.world.posts)
    for number, key in enumerate(posts):
        # Old ones first in `top`, then those among the newer sixty that `new` does not show any
        # more.
        paged.world.posts[key]["score"] = (
            10_000 if number < 15 else 9_000 if 60 <= number < 80 else 1
        )
    paged.crawl()
    since = len(paged.sandbox.ledger)
    paged.crawl(again=True)
    assert (listed(paged, "new", since), listed(paged, "top", since)) == (1, 4)
    since = len(paged.sandbox.ledger)
    paged.world.gone = {f"t3_{key}" for key in posts[75:]}
    paged.crawl(again=True)
    assert listed(paged, "new", since) == 2, (
        "fifteen are new, and the page that has the last of them reaches behind them"
    )
    paged.world.gone = set()
    since = len(paged.sandbox.ledger)
    paged.crawl(again=True)
    assert (listed(paged, "new", since), listed(paged, "top", since)) == (4, 4)
    assert read(paged) >= set(posts[60:])
    pages = [seen.path for seen in paged.sandbox.ledger.requests("^/comments/[a-z0-9]+/$")]
    assert len(pages) == len(set(pages)), "no post is read twice"


def test_a_round_that_was_cut_off_goes_on_with_again(paged: Work) -> None:
    paged.crawl()
    paged.world.gone = set()
    fault = paged.sandbox.faults.add("^/r/.*/new", status=503, after=2, times=None)
    assert paged.crawl(again=True)["failed"] == 1
    paged.sandbox.faults.remove(fault)
    since = len(paged.sandbox.ledger)
    paged.crawl(again=True)
    assert listed(paged, "new", since) == 2, "of four"
    assert read(paged) >= set(list(paged.world.posts)[80:])


@pytest.fixture
def wide(tmp_path: Any) -> Any:
    """One page shows 500 of 560 comments: sixty are behind a stub."""
    with Sandbox(small_world(24, width=560, depth=3), services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path, listings=("new",), search=())


def behind(work: Work) -> list[str]:
    post = list(work.world.posts)[CASES.index("wide")]
    return work.world.replies[f"t3_{post}"][500:]


@pytest.mark.parametrize("what", ["stub", "error"])
def test_a_stub_that_can_not_be_resolved_has_failed_and_does_not_wait(
    wide: Work, what: str
) -> None:
    keys = behind(wide)
    stub = {
        "kind": "more",
        "data": {"id": keys[0], "name": f"t1_{keys[0]}", "parent_id": "t3_x", "children": keys},
    }
    body = {"json": {"errors": [], "data": {"things": [stub]}}} if what == "stub" else SAYS_NO
    fault = wide.sandbox.faults.add("morechildren", status=200, body=body, times=None)
    summary = wide.crawl()
    assert fault.hits == (1 if what == "stub" else 5)
    assert (summary["failed"], summary["pending"]) == (len(keys), 0)
    filtered = wide.filter()
    assert (filtered["failed"], filtered["pending"]) == (len(keys), 0)
    failed = {row["key"]: row["reason"] for row in wide.table("clean", "reddit", "failed")}
    assert failed.keys() == {f"t1_{key}" for key in keys}
    if what == "stub":
        assert set(failed.values()) == {AGAIN}
    # The next run tries them again.
    wide.sandbox.faults.remove(fault)
    assert wide.crawl()["failed"] == 0
    filtered = wide.filter()
    assert (filtered["failed"], filtered["pending"]) == (0, 0)
    assert filtered["crawled"] == len(wide.world.posts) + len(wide.world.comments)


def test_what_is_not_asked_for_yet_still_waits(wide: Work) -> None:
    fault = wide.sandbox.faults.add(
        "morechildren", status=429, headers={"Retry-After": "3600"}, times=None
    )
    with pytest.raises(Exception, match="3600"):
        wide.crawl()
    wide.sandbox.faults.remove(fault)
    filtered = wide.filter()
    assert (filtered["failed"], filtered["pending"]) == (0, len(behind(wide)))


def test_pages_are_read_once_and_stubs_by_the_hundred(whole: Work) -> None:
    paths = [seen.path for seen in whole.asked]
    pages = Counter(path for path in paths if path.startswith("/comments/"))
    assert set(pages.values()) == {1}
    deep, wide = (
        list(whole.world.posts)[CASES.index("deep")],
        list(whole.world.posts)[CASES.index("wide")],
    )
    assert sum(path.startswith(f"/comments/{deep}/_/") for path in pages) == 4  # ten replies a page
    assert sum("morechildren" in path for path in paths) == 7  # 500 of 1,200 are on the page
    assert sum(path.startswith(f"/comments/{wide}/") for path in pages) == 1
    asked = sum(path.startswith(("/r/", "/comments/", "/api/")) for path in paths)
    assert whole.crawled["requests"] == asked


@pytest.mark.parametrize("status", [403, 404])
def test_a_post_that_is_shut_or_gone_is_a_fact_and_no_failure(work: Work, status: int) -> None:
    post = list(work.world.posts)[4]
    work.sandbox.faults.add(
        f"^/comments/{post}/", status=status, body={"message": "no", "error": status}, times=None
    )
    summary = work.crawl()
    assert (summary["failed"], summary["missing"]) == (0, 1)
    work.filter()
    rejected = {row["key"]: row["stage"] for row in work.table("clean", "reddit", "rejected")}
    kept = {f"t3_{row['post_id']}" for row in work.table("clean", "reddit", "posts")}
    assert (f"t3_{post}" in kept) == (status == 403)
    assert rejected.get(f"t3_{post}") == ("missing" if status == 404 else None)


def test_stubs_that_lead_nowhere_are_missing(work: Work) -> None:
    wide = list(work.world.posts)[CASES.index("wide")]
    lost = [
        key for key, comment in work.world.comments.items() if comment["link_id"] == f"t3_{wide}"
    ][-3:]
    work.sandbox.faults.add(
        "morechildren", then=lambda seen: work.world.gone.update(f"t1_{key}" for key in lost)
    )
    work.crawl()
    work.filter()
    rejected = {
        row["key"]: (row["stage"], row["reason"])
        for row in work.table("clean", "reddit", "rejected")
    }
    assert {rejected[f"t1_{key}"] for key in lost} == {("missing", "missing")}
