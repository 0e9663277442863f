"""What was deleted at its source, removed, or named leaves every folder, and does not come back."""

from pathlib import Path

import pytest

from kb.core.errors import LimitReached, Unreachable
from kb.sandbox.reddit.service import dumps
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.work import LATER, Work


def asked(work: Work, since: int) -> list[str]:
    return [
        name
        for seen in work.sandbox.ledger.requests("api/info", since=since)
        for name in seen.args["id"].split(",")
    ]


def test_nothing_is_due_before_its_time(tiny: Work) -> None:
    assert tiny.refresh() == {
        "command": "refresh reddit",
        "source": "reddit",
        "counted": "posts and comments",
        "crawled": 0,
        "missing": 0,
        "failed": 0,
        "requests": 0,
        "left": 0,
        "left_by": {},
    }


def test_what_is_old_is_read_again_by_the_hundred_and_the_newer_score_wins(
    tiny: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny.filter()
    post = tiny.table("clean", "reddit", "posts")[0]["post_id"]
    tiny.world.posts[post]["score"] = 77_777
    monkeypatch.setenv("KB_NOW", LATER)
    since = len(tiny.sandbox.ledger)
    summary = tiny.refresh()
    names = asked(tiny, since)
    assert len(names) == len(set(names)) == summary["crawled"]
    assert len(tiny.sandbox.ledger.requests("api/info", since=since)) == -(-len(names) // 100)
    tiny.filter()
    row = next(row for row in tiny.table("clean", "reddit", "posts") if row["post_id"] == post)
    assert (row["score"], row["score_source"], row["fetched_at"].year) == (77_777, "live", 2027)
    assert tiny.refresh()["crawled"] == 0


def test_an_answer_without_any_of_them_is_not_believed(
    tiny: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A subreddit that is closed for a day would be purged here."""
    tiny.purge()  # what was gone before
    tiny.filter()
    before = tiny.table("clean", "reddit", "comments")
    monkeypatch.setenv("KB_NOW", LATER)
    nothing = {"kind": "Listing", "data": {"children": [], "after": None}}
    fault = tiny.sandbox.faults.add("/api/info", status=200, body=nothing, times=None)
    for again in (False, True):
        with pytest.raises(Unreachable) as stop:
            tiny.refresh(again=again)
        done = stop.value.summary or {}
        assert (done["crawled"], done["missing"]) == (0, 0)
    assert fault.hits
    assert tiny.purge()["purged"] == 0
    tiny.filter()
    assert tiny.table("clean", "reddit", "comments") == before
    tiny.sandbox.faults.clear()
    done = tiny.refresh(again=True)
    assert (done["failed"], done["left"]) == (0, 0)
    assert done["crawled"] > len(before)
    assert done["missing"] < done["crawled"] / 2


@pytest.mark.parametrize("shut", [False, True])
def test_of_few_ids_the_subreddit_tells_whether_it_is_closed(
    tiny: Work, monkeypatch: pytest.MonkeyPatch, shut: bool
) -> None:
    monkeypatch.setattr("kb.reddit.crawl.refresh._NONE_OF", 10**6)  # as if all were few
    monkeypatch.setenv("KB_NOW", LATER)
    nothing = {"kind": "Listing", "data": {"children": [], "after": None}}
    private = {"reason": "private", "message": "Forbidden", "error": 403}
    tiny.sandbox.faults.add("/api/info", status=200, body=nothing, times=None)
    if shut:
        tiny.sandbox.faults.add("/r/[^/]*/new", status=403, body=private, times=None)
    since = len(tiny.sandbox.ledger)
    if shut:
        with pytest.raises(Unreachable) as stop:
            tiny.refresh()
    done = (stop.value.summary or {}) if shut else tiny.refresh()
    assert len(tiny.sandbox.ledger.requests("/new", since=since)) == 1
    assert (done["missing"] == 0, done["failed"] > 0) == (shut, shut)


def test_dumps_are_read_again_at_once(tmp_path: Path) -> None:
    with Sandbox(small_world(24, width=12, depth=12), services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path)
        summary = work.take_in(dumps(work.world, tmp_path / "dumps"))
        work.filter()
        dumped = {row["post_id"]: row for row in work.table("clean", "reddit", "posts")}
        assert {row["score_source"] for row in dumped.values()} == {"dump"}
        assert len(work.sandbox.ledger) == 0
        refreshed = work.refresh()
        assert 0 < refreshed["crawled"] <= summary["crawled"]
        work.filter()
        live = {row["post_id"]: row for row in work.table("clean", "reddit", "posts")}
        # The last three posts of the archive are gone by now.
        lost = {f"t3_{key}" for key in dumped.keys() - live.keys()}
        assert 0 < len(lost) <= 3
        assert lost <= {
            row["key"]
            for row in work.table("clean", "reddit", "rejected")
            if row["stage"] == "missing"
        }
        assert {row["score_source"] for row in live.values()} == {"live"}


def test_a_refresh_that_was_stopped_asks_only_for_the_rest(
    tiny: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KB_NOW", LATER)
    with pytest.raises(LimitReached) as stopped:
        tiny.refresh(limit=30)
    assert stopped.value.summary is not None
    assert stopped.value.summary["crawled"] == 30
    # One packet fails after its tries; the next run tries it again.
    fault = tiny.sandbox.faults.add("api/info", status=503, times=5)
    with pytest.raises(Unreachable):
        tiny.refresh()
    tiny.sandbox.faults.remove(fault)
    tiny.refresh()
    good = [
        name
        for seen in tiny.sandbox.ledger.requests("api/info")
        if seen.status == 200
        for name in seen.args["id"].split(",")
    ]
    assert len(good) == len(set(good))
    assert tiny.refresh()["crawled"] == 0


def test_everything_may_be_read_again_now(tiny: Work) -> None:
    """A removal request came in: what was read in this very second is due as well."""
    tiny.filter()
    there = {f"t3_{row['post_id']}" for row in tiny.table("clean", "reddit", "posts")}
    since = len(tiny.sandbox.ledger)
    tiny.world.removed.add(min(there))
    with pytest.raises(LimitReached):
        tiny.refresh(older_than=0, limit=30)
    # The same command goes on with the rest, and the next one begins anew.
    second = tiny.refresh(older_than=0)
    names = asked(tiny, since)
    assert there < set(names)
    assert len(names) == len(set(names)) == 30 + second["crawled"]
    assert tiny.refresh(older_than=0)["crawled"] == len(names)
    tiny.filter()
    left = {f"t3_{row['post_id']}" for row in tiny.table("clean", "reddit", "posts")}
    assert there - left == {min(there)}


def test_older_than_counts_days_instead_of_the_profile_s(
    tiny: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KB_NOW", "2026-11-25T12:00:00Z")  # five days later
    assert tiny.refresh()["crawled"] == tiny.refresh(older_than=6)["crawled"] == 0
    assert tiny.job().done("refresh", "reddit", "--older-than", "4", KB_NOW=LATER)["crawled"] > 0
