"""A purge leaves no trace of posts and comments."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from kb.artifacts import purge_raw
from kb.crawl.purge import remove_keys
from kb.reddit.purge import RULES
from kb.registry import SOURCES as CLASSES
from kb.sandbox.invented_ids import ELSEWHERE
from kb.sandbox.reddit.service import dumps
from kb.sandbox.reddit.subreddit import CASES
from kb.store.layout import Layout
from kb.store.state import tombstones
from tests.artifacts.purged import purged
from tests.reddit.work import Work, texts


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
    for layout in ("parquet", "minedojo", "text"):
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
    remove_keys(tiny.run(), CLASSES["reddit"].connector(tiny.run()), RULES, listed)
    monkeypatch.setattr(purge_raw, "_PARALLEL", 0)
    remove_keys(
        tiny.run(root=tmp_path / "other", workers=2),
        CLASSES["reddit"].connector(tiny.run(root=tmp_path / "other", workers=2)),
        RULES,
        listed,
    )
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

    def stop(*arguments: Any, **options: Any) -> int:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(purge_raw, "rewrite_segment", stop)
        with pytest.raises(KeyboardInterrupt):
            tiny.purge(ids)
    assert Layout(tiny.root).purge("reddit").exists()
    # The answers are not removed yet, and nothing that is made of them can be read.
    assert number_of_rows(tiny) == 0
    assert tiny.purge()["purged"] == 1
    assert 0 < number_of_rows(tiny) < before
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
        tiny.export("text")
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


@pytest.mark.parametrize("filtered", [False, True])
def test_each_name_is_told_apart(tiny: Work, filtered: bool) -> None:
    """Full names and addresses, in raw answers or tables; comments of a post go with it and don't
    count.
    """
    tiny.purge()  # what was deleted before
    if filtered:
        tiny.filter()
    post = list(tiny.world.posts)[CASES.index("text")]
    comment = next(
        key
        for key, one in tiny.world.comments.items()
        if one["link_id"] != f"t3_{post}" and one["body"] not in ("[deleted]", "[removed]")
    )
    lines = (
        f"https://www.reddit.com/r/x/comments/{post}/a_title/?utm_name=zzzzz",
        f"T1_{comment.upper()}",
        "t1_zzzzzzz",
        "https://www.reddit.com/user/somebody",
    )
    below = sum(
        one["link_id"] == f"t3_{post}" and one["body"] not in ("[deleted]", "[removed]")
        for one in tiny.world.comments.values()
    )
    assert purged(tiny.run(), "reddit", *lines) == (2, below, 0, 1, 1)
    assert {f"t3_{post}", f"t1_{comment}", "t1_zzzzzzz"} <= tombstones.keys(tiny.root, "reddit")
    assert purged(tiny.run(), "reddit", *lines) == (0, 0, 3, 0, 1)
