"""A crawl reads every post and comment once, whatever goes wrong on the way."""

import signal
from collections import Counter
from datetime import UTC, datetime
from typing import Any

import pytest

from kb.core.errors import (
    Blocked,
    CredentialRefused,
    FatalError,
    LimitReached,
    MissingCredential,
    OtherService,
    Unreachable,
)
from kb.reddit.parse import answers as parse
from kb.sandbox.invented_ids import PEOPLE
from kb.sandbox.reddit.service import CLIENT, SECRET, TOKEN
from kb.sandbox.reddit.subreddit import CASES
from kb.store.rawlog import rawlog
from tests.reddit.work import Work


def things(work: Work) -> dict[str, dict[str, Any]]:
    """What the raw data say of every post and comment, by full name."""
    found: dict[str, dict[str, Any]] = {}
    for kind in rawlog.kinds(work.root, "reddit"):
        lines = (
            line
            for path in rawlog.segments(work.root, "reddit", kind)
            for _, line in rawlog.Frames(path)
        )
        for rows in parse.rows(lines, kind, work.run().profile.reddit.links):
            found |= {row["fullname"]: row for row in rows.to_pylist() if row["state"] == "there"}
    return found


def everything(work: Work) -> set[str]:
    return {f"t3_{key}" for key in work.world.posts} | {f"t1_{key}" for key in work.world.comments}


def test_every_post_and_comment_is_there_with_its_values(whole: Work) -> None:
    found = things(whole)
    assert found.keys() == everything(whole)
    for key, post in whole.world.posts.items():
        row = found[f"t3_{key}"]
        assert (row["title"], row["score"], row["num_comments"]) == (
            post["title"],
            post.get("score"),
            post["num_comments"],
        )
    for key, comment in whole.world.comments.items():
        row = found[f"t1_{key}"]
        assert (row["text"], row["score"], row["parent_id"], row["post_id"]) == (
            comment["body"],
            comment["score"],
            comment["parent_id"],
            comment["link_id"][3:],
        )


def test_depths_of_a_deep_and_a_wide_tree(whole: Work) -> None:
    posts = list(whole.world.posts)
    depths: dict[str, list[int]] = {}
    for row in whole.table("clean", "reddit", "comments"):
        depths.setdefault(row["post_id"], []).append(row["depth"])
        assert row["depth"] == whole.world.comments[row["comment_id"]]["depth"]
    assert max(depths[posts[CASES.index("deep")]]) == 39
    assert set(depths[posts[CASES.index("wide")]]) == {0}
    assert len(depths[posts[CASES.index("wide")]]) > 1_050  # some are deleted


def test_odd_text_stays_as_far_as_arrow_can_hold_it(whole: Work) -> None:
    row = next(
        row for row in whole.table("clean", "reddit", "posts") if row["title"].startswith("A tower")
    )
    assert row["title"] == "A tower 🗼 مرحبا & <b>bold</b>"
    assert row["body"] == "tab\tand�nul and � alone"


def test_no_name_key_or_secret_in_any_file(whole: Work) -> None:
    key = (whole.root / "state" / "reddit.key").read_text()
    for path, text in whole.text().items():
        named = [name for name in (*PEOPLE, SECRET, TOKEN, CLIENT) if name in text]
        assert named == [], path
        assert (key in text) == (path == "state/reddit.key"), path
    assert oct((whole.root / "state" / "reddit.key").stat().st_mode & 0o777) == "0o600"


def test_a_finished_crawl_asks_nothing_and_a_new_round_little(work: Work) -> None:
    work.crawl()
    before = len(work.sandbox.ledger)
    assert work.crawl()["requests"] == 0
    assert len(work.sandbox.ledger) == before
    work.crawl(again=True)
    assert not work.sandbox.ledger.requests("^/comments/", since=before)


def test_limit_counts_posts_and_the_next_run_goes_on(work: Work) -> None:
    with pytest.raises(LimitReached) as stopped:
        work.crawl(limit=7)
    assert stopped.value.summary is not None
    assert stopped.value.summary["crawled"] == 7
    work.crawl()
    assert things(work).keys() == everything(work)
    assert set(
        Counter(seen.path for seen in work.sandbox.ledger.requests("^/comments/")).values()
    ) == {1}


def test_since_and_until_bound_the_posts(work: Work) -> None:
    made = sorted(post["created_utc"] for post in work.world.posts.values())
    summary = work.crawl(
        datetime.fromtimestamp(made[10], UTC), datetime.fromtimestamp(made[15], UTC)
    )
    assert summary["crawled"] == 5


def test_what_passes_leaves_no_gap(work: Work) -> None:
    faults = [
        {"path": "access_token", "status": 503, "times": 2},
        {"path": "^/r/", "status": 429, "headers": {"Retry-After": "0"}, "times": 2},
        {"path": "^/comments/", "status": 503, "times": 2},
        {"path": "^/comments/", "reset": True, "times": 2, "after": 3},
        {"path": "^/comments/", "cut": 0.5, "honest": True, "times": 2, "after": 6},
        {"path": "^/comments/", "cut": 0.5, "times": 1, "after": 9},
        {"path": "^/comments/", "status": 401, "times": 1, "after": 12},
        {"path": "morechildren", "status": 500, "times": 3},
    ]
    planned = [work.sandbox.faults.add(**fault) for fault in faults]
    work.crawl()
    assert [one.hits for one in planned] == [fault["times"] for fault in faults]
    assert things(work).keys() == everything(work)


def test_retry_after_is_waited_for(work: Work, hasty: None) -> None:
    work.sandbox.faults.add("^/r/", status=429, headers={"Retry-After": "1"})
    with pytest.raises(LimitReached):
        work.crawl(limit=1)
    first, second = work.sandbox.ledger.requests("^/r/")[:2]
    assert second.time - first.time >= 1


def test_rate_headers_are_heeded(work: Work, hasty: None) -> None:
    head = {"x-ratelimit-remaining": "0.0", "x-ratelimit-used": "1000", "x-ratelimit-reset": "1"}
    work.sandbox.faults.add("^/r/", status=500, headers=head)
    with pytest.raises(LimitReached):
        work.crawl(limit=1)
    first, second = work.sandbox.ledger.requests("^/r/")[:2]
    assert second.time - first.time >= 1


def test_429_without_end_is_a_block_and_no_fact_about_a_post(work: Work) -> None:
    fault = work.sandbox.faults.add("^/comments/", status=429, times=None, after=3)
    with pytest.raises(Blocked):
        work.crawl()
    before = fault.hits
    with pytest.raises(Blocked, match="still rejects"):
        work.crawl()
    assert fault.hits == before + 1  # one request finds out
    work.sandbox.faults.remove(fault)
    work.crawl()
    assert things(work).keys() == everything(work)


def test_an_hour_of_retry_after_stops_at_once(work: Work) -> None:
    fault = work.sandbox.faults.add(
        "^/comments/", status=429, headers={"Retry-After": "3600"}, times=None
    )
    with pytest.raises(Blocked, match="3600"):
        work.crawl()
    assert fault.hits == 1


def test_a_server_that_only_fails_is_unreachable_and_loses_nothing(work: Work) -> None:
    fault = work.sandbox.faults.add("^/comments/", status=502, times=None)
    with pytest.raises(Unreachable):
        work.crawl()
    assert fault.hits == 20  # five tries of three posts, and of another one as a probe
    work.sandbox.faults.remove(fault)
    work.crawl()
    assert things(work).keys() == everything(work)


def test_one_post_that_fails_is_counted_and_tried_again_by_the_next_run(work: Work) -> None:
    post = list(work.world.posts)[4]
    fault = work.sandbox.faults.add(f"^/comments/{post}/", status=500, times=None)
    assert work.crawl()["failed"] == 1
    work.sandbox.faults.remove(fault)
    assert work.crawl()["failed"] == 0
    assert things(work).keys() == everything(work)


@pytest.mark.parametrize("status", [400, 401, 403])
def test_a_refused_app_ends_after_the_first_answer(work: Work, status: int) -> None:
    """What a revoked key looks like; of one post, 403 is a fact about the post."""
    body = {"message": "Forbidden", "error": status}
    work.sandbox.faults.add("access_token", status=status, body=body, times=None)
    with pytest.raises(CredentialRefused, match="the key is wrong, or Reddit has revoked it") as no:
        work.crawl()
    assert len(work.sandbox.ledger) == 1
    assert "Responsible Builder Policy" in no.value.hint
    assert "kb reddit import" in no.value.hint


def test_a_token_that_is_refused_again_and_again_ends(work: Work) -> None:
    work.sandbox.faults.add("^/comments/", status=401, times=None)
    with pytest.raises(CredentialRefused):
        work.crawl()
    assert len(work.sandbox.ledger.requests("^/comments/")) <= 4


def test_a_subreddit_that_does_not_exist(work: Work) -> None:
    work.sandbox.faults.add(
        "^/r/",
        status=403,
        body={"reason": "private", "message": "Forbidden", "error": 403},
        times=None,
    )
    with pytest.raises(FatalError, match="private"):
        work.crawl()


def test_no_service_is_unreachable(work: Work) -> None:
    work.sandbox.servers["reddit"].stop()
    with pytest.raises(Unreachable):
        work.crawl()


@pytest.mark.parametrize("name", ["reddit_client_id", "reddit_client_secret", "kb_contact"])
def test_what_is_not_set_is_named_before_anything_is_sent_or_written(work: Work, name: str) -> None:
    run = work.run()
    settings = run.settings.model_copy(update={name: None})
    for command in (
        lambda one: work.crawl(settings=one),
        lambda one: work.refresh(settings=one),
        lambda one: work.rebuild(settings=one),
    ):
        with pytest.raises(MissingCredential, match=name.upper()):
            command(settings)
    assert len(work.sandbox.ledger) == 0
    assert not work.root.exists()


def test_another_host_is_refused(work: Work) -> None:
    with pytest.raises(LimitReached):
        work.crawl(limit=1)
    before = len(work.sandbox.ledger)
    with pytest.raises(OtherService):
        work.crawl(
            settings=work.run().settings.model_copy(
                update={"kb_reddit_endpoint": "http://127.0.0.2:9"}
            )
        )
    assert len(work.sandbox.ledger) == before


def test_killed_in_the_middle_only_what_was_in_flight_is_asked_again(work: Work) -> None:
    job = work.job()
    held = work.sandbox.faults.add("^/comments/", after=9, hold=True)
    child = job.start("reddit", "crawl")
    assert held.arrived.wait(60)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    held.release()
    work.crawl()
    again = Counter(
        f"{seen.path}?{seen.args.get('after', '')}{seen.args.get('q', '')}{seen.args.get('t', '')}"
        for seen in work.sandbox.ledger.requests("^/(comments|r)/")
    )
    assert sorted(count for count in again.values() if count > 1) == [2]
    assert things(work).keys() == everything(work)
    work.filter()


def test_the_command_ends_with_one_line_and_its_code(work: Work) -> None:
    work.sandbox.faults.add("access_token", status=401, times=None)
    line = work.job().stopped("reddit", "crawl", code=1)
    assert "REDDIT_CLIENT_ID" in line
    assert SECRET not in line
