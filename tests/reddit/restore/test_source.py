"""Tests of the requests of a reconstruction: known ids and whole trees."""

import json
import signal
from collections import Counter

import pyarrow.parquet as pq

from tests.reddit.restore.test_reconstruct import (
    missing,
    plain,
    released,
)
from tests.reddit.work import Work, rows


def test_mine_dojos_list_brings_whole_trees(whole: Work, far: Work) -> None:
    far.rebuild(whole.root / "export" / "minedojo" / "reddit.json")
    assert plain(rows(far.place / "out" / "posts")) == plain(
        whole.table("clean", "reddit", "posts")
    )
    assert plain(rows(far.place / "out" / "comments")) == plain(
        whole.table("clean", "reddit", "comments")
    )
    assert max(row["depth"] for row in rows(far.place / "out" / "comments")) == 39
    missing = {
        row["key"]: row["reason"]
        for row in pq.read_table(far.place / "out" / "missing.parquet").to_pylist()
    }
    assert set(missing.values()) == {"deleted", "removed"}


def test_a_published_post_that_is_gone_is_missing(work: Work) -> None:
    ids = work.place / "reddit.json"
    posts = list(work.world.posts)
    ids.write_text(json.dumps([{"id": posts[0], "type": "text"}, {"id": "zzzzz", "type": "image"}]))
    assert work.rebuild(ids)["posts"] == 1
    posts_missing = {key: why for key, why in missing(work).items() if key.startswith("t3_")}
    assert posts_missing == {"t3_zzzzz": "missing"}


def test_an_answered_reconstruction_asks_nothing_and_again_asks_anew(
    whole: Work, far: Work
) -> None:
    first = far.rebuild(released(whole))
    since = len(far.sandbox.ledger)
    assert far.rebuild(released(whole)) == {**first, "requests": 0}
    assert len(far.sandbox.ledger) == since
    assert far.rebuild(released(whole), again=True)["requests"] == first["requests"]
    assert [
        path.name for path in (far.place / "out").iterdir() if path.name.startswith(".work")
    ] == []


def test_killed_in_the_middle_only_what_was_in_flight_is_asked_again(
    whole: Work, far: Work
) -> None:
    since = len(far.sandbox.ledger)
    held = far.sandbox.faults.add("api/info", after=5, hold=True)
    child = far.job().start(
        "reddit", "reconstruct", "--ids", str(released(whole)), "--out", str(far.place / "out")
    )
    assert held.arrived.wait(60)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    held.release()
    assert not (far.place / "out" / "posts").exists()
    far.rebuild(released(whole))
    asked = Counter(
        seen.args["id"] for seen in far.sandbox.ledger.requests("api/info", since=since)
    )
    assert sorted(asked.values()) == [1] * (len(asked) - 1) + [2]
    assert plain(rows(far.place / "out" / "comments")) == plain(
        whole.table("clean", "reddit", "comments")
    )


def test_a_request_that_fails_is_counted_and_tried_by_the_next_run(whole: Work, far: Work) -> None:
    """It fails for one id: the hundred that are asked for with it are read."""
    bad = whole.table("clean", "reddit", "posts")[-1]["post_id"]
    fault = far.sandbox.faults.add(f"api/info.*t3_{bad}", status=500, times=None)
    summary = far.rebuild(released(whole))
    far.sandbox.faults.remove(fault)
    assert (summary["failed"], summary["missing"]) == (1, 0)
    missing = pq.read_table(far.place / "out" / "missing.parquet").to_pylist()
    assert [(row["key"], row["reason"]) for row in missing] == [(f"t3_{bad}", "failed")]
    since = len(far.sandbox.ledger)
    assert far.rebuild(released(whole))["missing"] == 0
    assert len(far.sandbox.ledger.requests("api/info", since=since)) == 1
