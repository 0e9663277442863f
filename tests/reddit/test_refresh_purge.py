"""What was deleted at its source, removed, or named leaves every folder, and does not come back."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from kb.artifacts import purge, purge_rows
from kb.core.errors import LimitReached, Unreachable
from kb.crawl.purge import purge_answers
from kb.reddit.connector.plan import plan_refresh
from kb.reddit.parse.remove_ids import strip
from kb.reddit.purge import RULES
from kb.sandbox.invented_ids import ELSEWHERE
from kb.sandbox.reddit.service import dumps
from kb.sandbox.reddit.subreddit import CASES
from kb.sandbox.server import Sandbox
from kb.store import tombstones
from kb.store.layout import Layout
from kb.store.lock import writer
from kb.store.rawlog import Envelope, Request
from tests.reddit.conftest import small_world
from tests.reddit.raw import listing
from tests.reddit.work import LATER, Work, texts


@pytest.fixture
def tiny(tmp_path: Path) -> Any:
    """Each case once with small trees, crawled."""
    with Sandbox(small_world(24, width=12, depth=12), services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path, listings=("new",), search=())
        work.crawl()
        yield work


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
    monkeypatch.setattr("kb.reddit.connector.refresh._NONE_OF", 10**6)  # as if all were few
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


def test_a_plan_waits_for_no_writer(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", LATER)
    files = {path: path.stat().st_mtime_ns for path in tiny.root.rglob("*") if path.is_file()}
    with writer(tiny.root, "reddit"):
        planned = plan_refresh(tiny.run())
    del files[tiny.root / "state" / "reddit.lock"]
    assert planned["phases"][0]["items"] > 100
    assert {path: path.stat().st_mtime_ns for path in files} == files


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


def test_a_purge_leaves_no_trace_in_any_file(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    world, posts = tiny.world, list(tiny.world.posts)
    text, image, link = (posts[CASES.index(case)] for case in ("text", "image", "link"))
    talk = [
        key
        for key, comment in world.comments.items()
        if comment["link_id"][3:] not in (text, image, link)
        and comment["body"] not in ("[deleted]", "[removed]")
    ]
    leaves = [key for key in talk if f"t1_{key}" not in world.replies][:2]
    # What can be told from everything else in the world.
    for number, key in enumerate((text, image, link)):
        world.posts[key] |= {
            "title": f"Unmistakable title {number}",
            "selftext": f"Unmistakable text {number}",
        }
    for number, key in enumerate(leaves):
        world.comments[key]["body"] = f"Unmistakable comment {number} 🗼"
    monkeypatch.setenv("KB_NOW", "2026-12-25T12:00:00Z")
    tiny.refresh()
    tiny.filter()
    for layout in ("parquet", "minedojo", "convokit"):
        tiny.export(layout)
    tiny.rebuild(out=tiny.root / "export" / "reconstructed")
    everywhere = " ".join(texts(tiny.root).values())
    assert all(
        f"Unmistakable {what}" in everywhere
        for what in ("title 0", "text 0", "comment 0", "comment 1")
    )

    world.gone |= {f"t3_{text}", f"t1_{leaves[0]}"}
    world.removed |= {f"t3_{image}", f"t1_{leaves[1]}"}
    monkeypatch.setenv("KB_NOW", "2027-03-01T12:00:00Z")
    tiny.refresh()
    ids = tiny.place / "ids.txt"
    ids.write_text(f"t3_{link}\n")
    tiny.purge(ids)
    names = [f"t3_{text}", f"t3_{image}", f"t3_{link}", f"t1_{leaves[0]}", f"t1_{leaves[1]}"]
    below = [key for key, comment in world.comments.items() if comment["link_id"] in names]
    for path, found in texts(tiny.root).items():
        assert "Unmistakable" not in found, path
        if Path(path).stem == "tombstones":
            continue
        for key in (text, image, link, *leaves, *below):
            assert key not in found, f"{key} in {path}"
    reasons = {row["key"]: row["reason"] for row in tombstone_rows(tiny)}
    assert {name: reasons[name] for name in names} == dict(
        zip(names, ("missing", "removed", "named", "missing", "removed"), strict=True)
    )

    # It does not come back: not by another round, nor by a dump that holds it, nor by another
    # filter.
    since = len(tiny.sandbox.ledger)
    tiny.crawl(again=True)
    assert not [
        seen
        for seen in tiny.sandbox.ledger.requests("^/comments/", since=since)
        if link in seen.path
    ]
    tiny.filter()
    assert not set(names) & {
        f"t3_{row['post_id']}" for row in tiny.table("clean", "reddit", "posts")
    }
    assert "Unmistakable" not in " ".join(texts(tiny.root).values())
    assert tiny.purge()["purged"] == 0


def tombstone_rows(work: Work) -> list[dict[str, Any]]:
    import pyarrow.parquet as pq

    return pq.read_table(tombstones.path(work.root, "reddit")).to_pylist()


def test_replies_to_a_purged_comment_stay(tiny: Work) -> None:
    deep = list(tiny.world.posts)[CASES.index("deep")]
    chain = [
        key for key, comment in tiny.world.comments.items() if comment["link_id"] == f"t3_{deep}"
    ]
    ids = tiny.place / "ids"
    ids.write_text(f"t1_{chain[2]}")
    tiny.purge(ids)
    tiny.filter()
    rows = {row["comment_id"]: row["depth"] for row in tiny.table("clean", "reddit", "comments")}
    gone = [
        key
        for key, comment in tiny.world.comments.items()
        if comment["body"] in ("[deleted]", "[removed]")
    ]
    assert chain[2] not in rows
    for key in chain[3:]:
        assert key in rows or key in gone
        assert rows.get(key) is None  # an ancestor is unknown


def number_of_rows(work: Work) -> int:
    folders = ("posts", "comments", "rejected", "failed", "pending")
    return sum(len(work.table("clean", "reddit", name)) for name in folders)


def test_a_purge_in_worker_processes_leaves_the_same(
    tiny: Work, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of much raw data the segments are written again by several processes."""
    comment, post = next(iter(tiny.world.comments)), next(iter(tiny.world.posts))
    tiny.take_in(dumps(tiny.world, tiny.place / "dumps"))
    ids = tiny.place / "ids"
    ids.write_text(f"t1_{comment}\nt3_{post}\n")
    shutil.copytree(tiny.root, tmp_path / "other")
    listed = RULES.read_ids(ids, None)
    purge_answers(tiny.run(), RULES, listed)
    monkeypatch.setattr(purge, "_PARALLEL", 0)
    purge_answers(tiny.run(root=tmp_path / "other", workers=2), RULES, listed)
    one, two = (texts(root / "raw") for root in (tiny.root, tmp_path / "other"))
    del one["reddit/tombstones.parquet"], two["reddit/tombstones.parquet"]
    assert one == two
    assert f'"{comment}"' not in "".join(two.values())


def test_a_purge_that_was_cut_off_goes_on(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    post = next(iter(tiny.world.posts))
    tiny.filter()
    ids = tiny.place / "ids"
    ids.write_text(f"t3_{post}")
    before = number_of_rows(tiny)
    keep = purge_rows.keep_rows

    def cut_off(*arguments: Any, **options: Any) -> int:
        went = keep(*arguments, **options)
        if went:
            # Most of what is to be removed is still there.
            monkeypatch.setattr(purge_rows, "keep_rows", stop)
        return went

    def stop(*arguments: Any, **options: Any) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(purge_rows, "keep_rows", cut_off)
    with pytest.raises(KeyboardInterrupt):
        tiny.purge(ids)
    assert Layout(tiny.root).purge("reddit").exists()
    assert number_of_rows(tiny) < before
    monkeypatch.setattr(purge_rows, "keep_rows", keep)
    assert tiny.purge()["rows"] > 0
    assert post not in {
        row["post_id"]
        for name in ("posts", "comments")
        for row in tiny.table("clean", "reddit", name)
    }
    assert not Layout(tiny.root).purge("reddit").exists()


@pytest.mark.parametrize("known_from", ["raw", "address"])
def test_a_crosspost_shows_nothing_of_a_purged_parent(tiny: Work, known_from: str) -> None:
    crosspost, parent = list(tiny.world.posts)[CASES.index("crosspost")], ELSEWHERE
    shown = {
        "raw": f"https://v.redd.it/{parent}",
        "address": f"https://www.reddit.com/gallery/{parent}",
    }[known_from]
    post = tiny.world.posts[crosspost]
    post |= {
        "url": shown,
        "crosspost_parent_list": [{**post["crosspost_parent_list"][0], "url": shown}],
    }
    whole = tiny.place / "whole.txt"
    whole.write_text(f"t3_{crosspost}\n")
    tiny.rebuild(whole, tiny.root / "export" / "reconstructed")
    if known_from == "raw":
        tiny.filter()
        tiny.export("convokit")
    else:  # the user has no raw answers of his own
        shutil.rmtree(tiny.root / "raw" / "reddit")
        (tiny.root / "state" / "reddit.sqlite").unlink()
    assert shown in " ".join(tiny.text().values())
    ids = tiny.place / "ids"
    ids.write_text(f"t3_{parent}\n")
    tiny.purge(ids)
    assert not [path for path, found in tiny.text().items() if shown in found]
    row = next(
        row for row in tiny.table("export", "reconstructed", "posts") if row["post_id"] == crosspost
    )
    assert (row["is_crosspost"], row["type"], row["source_url"], row["link_kind"]) == (
        True,
        "text",
        None,
        None,
    )
    if known_from == "raw":
        after = tiny.table("clean", "reddit", "posts")
        assert crosspost in {row["post_id"] for row in after}
        tiny.filter()
        assert tiny.table("clean", "reddit", "posts") == after, "the filter says the same"


def test_a_comment_with_a_posts_bare_id_is_another_thing(tiny: Work) -> None:
    tiny.filter()
    row = tiny.table("clean", "reddit", "comments")[0]
    ids = tiny.place / "ids"
    ids.write_text(f"t3_{row['comment_id']}")
    tiny.purge(ids)
    assert tiny.table("clean", "reddit", "comments")[0] == row


def thing(kind: str, key: str, **fields: Any) -> dict[str, Any]:
    return {"kind": kind, "data": {"id": key, "name": f"{kind}_{key}", **fields}}


COMMENT = thing(
    "t1", "c", link_id="t3_p", replies=listing(thing("t1", "d", link_id="t3_p", replies=""))
)
SHARED = thing(
    "t3",
    "x",
    crosspost_parent="t3_p",
    crosspost_parent_list=[{"id": "p", "title": "t"}],
    url="/r/M/comments/p/title/",
)


@pytest.mark.parametrize(
    ("kind", "params", "answer", "keys", "expected"),
    [
        (
            "listings",
            {"after": "t3_p"},
            listing(thing("t3", "p"), thing("t3", "q"), after="t3_p"),
            {"t3_p"},
            ({"after": ""}, listing(thing("t3", "q"), after="t3_q")),
        ),
        (
            "listings",
            {},
            listing(SHARED),
            {"t3_p"},
            ({}, listing(thing("t3", "x", crosspost_parent="t3_p", crosspost_parent_list=[]))),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("t3", "p")), listing(COMMENT)],
            {"t3_p"},
            None,
        ),
        (
            "comments",
            {"article": "p", "comment": "c"},
            [listing(thing("t3", "p")), listing(COMMENT)],
            {"t1_c"},
            (
                {"article": "p"},
                [listing(thing("t3", "p")), listing(thing("t1", "d", link_id="t3_p", replies=""))],
            ),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(COMMENT)],
            {"t1_d"},
            ({"article": "p"}, [listing(thing("t1", "c", link_id="t3_p", replies=listing()))]),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("more", "a", children=["a", "b"], parent_id="t3_p"))],
            {"t1_a"},
            (
                {"article": "p"},
                [
                    listing(
                        {
                            "kind": "more",
                            "data": {
                                "id": "b",
                                "name": "t1_b",
                                "children": ["b"],
                                "parent_id": "t3_p",
                            },
                        }
                    )
                ],
            ),
        ),
        (
            "comments",
            {"article": "p"},
            [listing(thing("more", "a", children=["a"], parent_id="t3_p"))],
            {"t1_a"},
            ({"article": "p"}, [listing()]),
        ),
        ("comments", {"article": "p"}, None, {"t3_p"}, None),
        (
            "morechildren",
            {"link_id": "t3_p", "children": "c,e"},
            {"json": {"errors": [], "data": {"things": [COMMENT]}}},
            {"t1_c"},
            (
                {"link_id": "t3_p", "children": "e"},
                {
                    "json": {
                        "errors": [],
                        "data": {"things": [thing("t1", "d", link_id="t3_p", replies="")]},
                    }
                },
            ),
        ),
        (
            "morechildren",
            {"link_id": "t3_p", "children": "c"},
            {"json": {"data": {"things": [COMMENT]}}},
            {"t3_p"},
            None,
        ),
        (
            "info",
            {"id": "t3_p,t1_c,t1_z", "posts": ["p", "p", "q"]},
            listing(thing("t3", "p"), COMMENT),
            {"t3_p"},
            ({"id": "t1_z", "posts": ["q"]}, listing()),
        ),
        ("info", {"id": "t3_p"}, listing(thing("t3", "p")), {"t3_p"}, None),
        ("dumps", {}, listing(thing("t3", "p"), thing("t1", "c", link_id="t3_p")), {"t3_p"}, None),
    ],
)
def test_what_strip_leaves(
    kind: str, params: dict[str, Any], answer: Any, keys: set[str], expected: Any
) -> None:
    left = strip(kind, Envelope("2026-01-01T00:00:00Z", Request(kind, params), 200, answer), keys)
    assert (None if left is None else (left.request.params, left.response)) == expected


def test_an_envelope_without_the_keys_is_the_same_object() -> None:
    envelope = Envelope(
        None,
        Request("comments/p", {"article": "p"}),
        200,
        [listing(thing("t3", "p")), listing(COMMENT)],
    )
    assert strip("comments", envelope, {"t3_other", "t1_other"}) is envelope
