"""An answer of status 200 that is not what was asked for is tried again, and never a fact about
anything.
"""

import json
from typing import Any

import pytest

from kb.core.errors import Unreachable
from kb.reddit.crawl import refresh
from kb.reddit.crawl.errors import problem
from kb.store.rawlog import rawlog
from tests.reddit.raw import comment, listing, post
from tests.reddit.work import LATER, Work

BUSY = {"message": "we are busy, try again later", "reason": None}
STUB = {"kind": "more", "data": {"id": "_", "children": []}}
ODD = [
    {"kind": "Listing"},
    {"kind": "Listing", "data": {"children": None}},
    listing({"kind": "t3"}),
    listing({"data": {"id": "x"}}),
    [listing()],
    BUSY,
]


@pytest.mark.parametrize(
    ("path", "answer"),
    [
        ("api/info/", listing()),
        ("api/info/", listing(post("a"), comment("b"))),
        ("r/Minecraft/new", listing(post("a"), after="t3_a")),
        ("r/Minecraft/search", listing()),
        ("comments/a/", [listing(post("a")), listing(comment("b"), STUB)]),
        ("comments/a/_/b/", [listing(post("a")), listing()]),
        ("api/morechildren/", {"json": {"errors": [], "data": {"things": []}}}),
        ("api/morechildren/", {"json": {"errors": [], "data": {"things": [comment("b"), STUB]}}}),
        ("api/v1/me", BUSY),
    ],
)
def test_what_is_asked_for_has_its_form(path: str, answer: Any) -> None:
    assert problem(path, answer) == ""


@pytest.mark.parametrize(
    ("path", "answer"),
    [
        *(("api/info/", answer) for answer in ODD),
        *(
            ("r/Minecraft/new", answer)
            for answer in [
                *ODD,
                [1, 2],
                {"reason": "private", "message": "Forbidden", "data": None},
            ]
        ),
        *(
            ("comments/a/", answer)
            for answer in [
                *ODD,
                [listing(post("a"))],
                [listing(), listing()],
                [listing(post("a")), BUSY],
                [listing(post("a")), listing(5)],
            ]
        ),
        *(
            ("api/morechildren/", answer)
            for answer in [
                BUSY,
                listing(),
                {"json": {"data": {"things": None}}},
                {"json": {"errors": [["RATELIMIT", "x"]]}},
            ]
        ),
        ("api/morechildren/", {"json": {"errors": "busy"}}),
        ("api/info/", None),
        ("api/info/", "text"),
    ],
)
def test_what_has_another_form_is_no_answer(path: str, answer: Any) -> None:
    assert problem(path, answer) != ""


def test_a_message_in_place_of_info_makes_nothing_missing(
    few: Work, monkeypatch: pytest.MonkeyPatch
) -> None:
    few.crawl()
    few.filter()
    kept = few.table("clean", "reddit", "posts")
    monkeypatch.setenv("KB_NOW", LATER)
    fault = few.sandbox.faults.add("api/info", status=200, body=BUSY, times=None)
    with pytest.raises(Unreachable) as stop:
        few.refresh()
    assert stop.value.summary is not None
    assert (stop.value.summary["crawled"], stop.value.summary["missing"]) == (0, 0)
    assert rawlog.segments(few.root, "reddit", "info") == []
    few.purge()  # what was deleted before, and no more
    assert few.table("clean", "reddit", "posts") == kept
    few.sandbox.faults.remove(fault)
    assert few.refresh()["crawled"] >= len(kept)
    few.filter()
    assert {row["post_id"] for row in few.table("clean", "reddit", "posts")} == {
        row["post_id"] for row in kept
    }


def test_nearly_everything_missing_is_worth_a_word_and_can_be_asked_again(
    few: Work, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    few.crawl()
    monkeypatch.setenv("KB_NOW", LATER)
    # An answer without any of many is not believed; stands for answers that have one of them each.
    monkeypatch.setattr(refresh, "_NONE_OF", 10**9)
    fault = few.sandbox.faults.add("api/info", status=200, body=listing(), times=None)
    summary = few.refresh()
    assert summary["missing"] == summary["crawled"] > 100
    assert "before `kb purge reddit`" in caplog.text
    few.sandbox.faults.remove(fault)
    caplog.clear()
    assert few.refresh()["crawled"] == 0
    assert few.refresh(again=True)["missing"] == 0
    assert few.refresh(again=True)["crawled"] == 0, "nothing is missing any more"
    assert "kb purge" not in caplog.text


@pytest.mark.parametrize(
    "body", [BUSY, "[1,2]", '[{"kind": "Listing"}, {}]'], ids=["message", "list", "half"]
)
def test_posts_and_listings_without_an_answer_are_read_by_the_next_run(
    few: Work, body: Any
) -> None:
    listings = few.sandbox.faults.add("^/r/", status=200, body=body, times=None)
    with pytest.raises(Unreachable):
        few.crawl()
    few.sandbox.faults.remove(listings)
    pages = few.sandbox.faults.add("^/comments/", status=200, body=body, times=5)
    assert few.crawl()["failed"] == 1
    assert pages.hits == 5
    assert few.crawl()["failed"] == 0
    few.filter()
    found = {row["comment_id"] for row in few.table("clean", "reddit", "comments")}
    found |= {row["key"][3:] for row in few.table("clean", "reddit", "rejected")}
    assert few.world.comments.keys() <= found


def test_a_reconstruction_writes_no_such_answer_down(few: Work) -> None:
    ids = few.place / "ids.txt"
    ids.write_text("\n".join(f"t3_{key}" for key in few.world.posts))
    fault = few.sandbox.faults.add("api/info", status=200, body={"kind": "Listing"}, times=None)
    with pytest.raises(Unreachable):
        few.rebuild(ids)
    assert not list((few.place / "out").glob("*.parquet"))
    few.sandbox.faults.remove(fault)
    assert few.rebuild(ids)["failed"] == 0
    assert len(few.table(str(few.place / "out" / "posts"))) > 10


def test_a_service_that_only_sends_messages_is_down(few: Work) -> None:
    few.sandbox.faults.add("^/comments/", status=200, body=BUSY, times=None)
    with pytest.raises(Unreachable):
        few.crawl()


@pytest.mark.parametrize(("status", "failed", "missing"), [(410, 0, 1), (418, 1, 0), (400, 1, 0)])
def test_an_odd_status_for_one_post_is_about_that_post(
    few: Work, status: int, failed: int, missing: int
) -> None:
    key = list(few.world.posts)[4]
    few.sandbox.faults.add(f"^/comments/{key}/", status=status, body={"message": "no"}, times=None)
    summary = few.crawl()
    assert (summary["failed"], summary["missing"], summary["pending"]) == (failed, missing, 0)
    few.filter()
    rejected = {row["key"]: row["stage"] for row in few.table("clean", "reddit", "rejected")}
    assert rejected.get(f"t3_{key}") == ("missing" if status == 410 else None)


def test_an_answer_too_deep_to_be_read_is_a_post_that_failed(few: Work) -> None:
    key = list(few.world.posts)[4]
    deep = '[{"kind": "Listing", "data": {"children": ' * 300 + "[]" + "}}]" * 300
    few.sandbox.faults.add(f"^/comments/{key}/", status=200, body=deep, times=None)
    assert few.crawl()["failed"] == 1


def test_a_hundred_and_ninety_replies_below_each_other_are_read(few: Work) -> None:
    key = list(few.world.posts)[4]
    front = []  # in pieces, as a writer of JSON has the same limit
    for number in range(190):
        parent = f"t1_n{number - 1}" if number else f"t3_{key}"
        front.append(
            json.dumps(
                listing(comment(f"n{number}", link_id=f"t3_{key}", parent_id=parent))
            ).replace('"created_utc"', '"replies": REST, "created_utc"')
        )
    text = '""'
    for piece in reversed(front):
        text = piece.replace("REST", text)
    few.sandbox.faults.add(
        f"^/comments/{key}/",
        status=200,
        body=f"[{json.dumps(listing(post(key)))}, {text}]",
        times=None,
    )
    job = few.job()
    job.fresh = True  # a fork has the frames of its server below it, as many as 190 levels need
    assert job.done("reddit", "crawl", "--quiet")["failed"] == 0
    job.done("reddit", "filter", "--quiet")
    depths = {row["comment_id"]: row["depth"] for row in few.table("clean", "reddit", "comments")}
    assert [depths.get(f"n{number}") for number in range(190)] == list(range(190))
