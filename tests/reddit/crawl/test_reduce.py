"""The end of a crawl, later rounds, and stubs that nothing comes of."""

from typing import Any

import pytest

from kb.core.progress import Silent
from kb.reddit.crawl.reduce import AGAIN
from kb.sandbox.reddit.subreddit import CASES
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.work import Work

SAYS_NO = {"json": {"errors": [["RATELIMIT", "you are doing that too much", "ratelimit"]]}}


class Said(Silent):
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
