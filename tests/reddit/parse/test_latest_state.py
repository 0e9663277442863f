"""What refresh and purge go by: the newest answer about each thing, of a raw log in many
buckets.
"""

from pathlib import Path
from typing import Any

import pytest

from kb.core.errors import DamagedData
from kb.crawl.purge import dry_purge
from kb.reddit.parse.latest_state import latest_state
from kb.reddit.purge import RULES
from kb.registry import SOURCES as CLASSES
from kb.sandbox.reddit.service import dumps
from kb.store.rawlog import rawlog
from kb.store.rawlog.rawlog import envelopes
from kb.store.state import tombstones
from kb.store.tables import partition
from tests.faults import Sandbox
from tests.reddit.conftest import small_world
from tests.reddit.raw import comment, listing, post, write
from tests.reddit.work import Work


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A data root whose few answers fill many buckets."""
    monkeypatch.setattr(partition, "RAW_BYTES", 200)
    with Sandbox(small_world(24, width=12, depth=12), services=["reddit"]) as sandbox:
        yield Work(sandbox, tmp_path)


def test_the_newest_answer_counts_whatever_kind_it_is_of(work: Work) -> None:
    deleted, removed = (
        post("taken", selftext="[deleted]"),
        comment("back", link_id="t3_taken", body="[removed]"),
    )
    write(work.root, "dumps", {}, listing(post("undated"), deleted, removed), None)
    write(
        work.root,
        "info",
        {"id": "t3_taken,t1_lost", "posts": ["taken", ""]},
        listing(),
        "2026-03-01T00:00:00Z",
    )
    live = (
        post("taken"),
        comment("lost", link_id="t3_undated"),
        comment("back", link_id="t3_taken"),
    )
    write(work.root, "listings", {}, listing(*live), "2026-02-01T00:00:00Z")
    with latest_state(work.run()) as things:
        rows = {row["fullname"]: row for part in things for row in part.to_pylist()}
        assert len(list(things)) > 1, "one bucket shows nothing"
    months = {name: row["fetched_at"] and row["fetched_at"].month for name, row in rows.items()}
    assert {
        name: (row["post_id"], row["there"], row["gone"], row["live"], months[name])
        for name, row in rows.items()
    } == {
        "t3_undated": ("undated", True, None, False, None),
        "t3_taken": ("taken", False, None, True, 3),
        "t1_back": ("taken", True, None, True, 2),
        # The answer that it is missing does not say of which post it was; the older one does.
        "t1_lost": ("undated", False, None, True, 3),
    }


def test_comments_go_with_their_post_whenever_it_went(work: Work) -> None:
    write(work.root, "dumps", {}, listing(post("now", selftext="[deleted]"), post("stays")), None)
    below = [comment(f"below_{key}", link_id=f"t3_{key}") for key in ("now", "old", "stays")]
    write(work.root, "comments", {"article": "now"}, listing(*below))
    tombstones.add_tombstones(work.root, "reddit", [("t3_old", "named")])
    with dry_purge(work.run(), CLASSES["reddit"].connector(work.run()), RULES, None) as purge:
        keys = purge.keys
    assert keys == {
        "t3_now": "deleted",
        "t1_below_now": "post",
        "t1_below_old": "post",
    }


def test_posts_are_asked_for_first_then_comments_post_by_post(work: Work, tmp_path: Path) -> None:
    work.take_in(dumps(work.world, tmp_path / "dumps"))
    work.refresh()
    asked = [envelope.request.params for envelope in envelopes(work.root, "reddit", "info")]
    names = [name for params in asked for name in params["id"].split(",")]
    trees = [post for params in asked for post in params["posts"]]
    first = sum(name.startswith("t3_") for name in names)
    assert all(name.startswith("t3_") for name in names[:first])
    assert trees[first:] == sorted(trees[first:])
    assert len(set(trees[first:])) > 3


def test_a_damaged_answer_is_named_and_not_taken_for_none(work: Work) -> None:
    """What was not read would be neither refreshed nor purged, and nobody would hear of it."""
    write(work.root, "listings", {}, listing(post("first")), "2026-02-01T00:00:00Z")
    [path] = rawlog.segments(work.root, "reddit", "listings")
    data = bytearray(path.read_bytes())
    data[10:20] = b"\xff" * 10
    path.write_bytes(data)
    named = f"{path.name} is damaged at byte 0"
    with pytest.raises(DamagedData, match=named), latest_state(work.run()):
        pass
    with (
        pytest.raises(DamagedData, match=path.name),
        dry_purge(work.run(), CLASSES["reddit"].connector(work.run()), RULES, None),
    ):
        pass


def test_nothing_is_left_of_the_work(work: Work, tmp_path: Path) -> None:
    work.take_in(dumps(work.world, tmp_path / "dumps"))
    work.refresh()
    assert not list(work.root.rglob(".reddit.known*"))
