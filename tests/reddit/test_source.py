"""What other rooms learn from the source: status, plan, passages."""

import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest

from kb.core.config.profile import load_profile
from kb.reddit.passages import passages
from kb.reddit.plan import plan_refresh
from kb.sandbox.reddit.subreddit import CASES
from kb.store.lock import writer
from tests.faults import Sandbox
from tests.recipes import release
from tests.reddit.conftest import small_world
from tests.reddit.raw import comment, listing, post, write
from tests.reddit.work import LATER, Work
from tests.search.made import write as write_table


@pytest.fixture
def broken(tmp_path: Path) -> Any:
    """One tree, one thread and one stub answer 503; each read otherwise."""
    with Sandbox(small_world(24, width=520, depth=24), services=["reddit"]) as sandbox:
        work = Work(sandbox, tmp_path, listings=("new",), search=())
        deep = list(work.world.posts)[CASES.index("deep")]
        for path in (f"^/comments/{tree(work)}/", f"^/comments/{deep}/_/", "morechildren"):
            sandbox.faults.add(path, status=503, times=None)
        work.crawled = work.crawl()
        yield work


def tree(work: Work) -> str:
    """A kept post with comments, whose page fails."""
    usual = list(work.world.posts.items())[:10]
    return next(key for key, row in usual if row["num_comments"] > 1 and row["score"] >= 5)


def rows_of(work: Work, folder: str, name: str) -> list[dict[str, Any]]:
    """The rows of a table in clean/ or release/."""
    place = work.root / folder / "reddit"
    paths = (
        (place / name).glob("*.parquet") if folder == "clean" else place.glob(f"{name}-*.parquet")
    )
    return [row for path in sorted(paths) for row in pq.read_table(path).to_pylist()]


def unread(work: Work) -> dict[str, int]:
    return {
        row["post_id"]: row["comments_unread"]
        for row in work.table("clean", "reddit", "posts")
        if row["comments_unread"]
    }


def expected(work: Work) -> dict[str, int]:
    posts = list(work.world.posts)
    deep, wide = posts[CASES.index("deep")], posts[CASES.index("wide")]
    # Ten replies of the deep tree and 500 of the wide one are on their pages.
    return {tree(work): work.world.posts[tree(work)]["num_comments"], deep: 24 - 10, wide: 20}


def test_a_post_says_what_of_its_tree_was_not_read(broken: Work) -> None:
    broken.filter()
    assert unread(broken) == expected(broken)
    broken.export()
    released = {
        row["post_id"]: (row["comments_released"], row["comments_unread"])
        for row in rows_of(broken, "release", "posts")
    }
    comments = rows_of(broken, "release", "comments")
    for key, (below, left) in released.items():
        assert below == sum(row["post_id"] == key for row in comments)
        assert left == expected(broken).get(key, 0)


def test_the_same_words_and_numbers_everywhere(broken: Work) -> None:
    filtered, exported = broken.filter(), broken.export()
    assert broken.crawled["failed"] == filtered["failed"] == 1 + 1 + 20
    assert {one["incomplete_posts"] for one in (broken.crawled, filtered, exported)} == {3}
    failed = {row["key"] for row in broken.table("clean", "reddit", "failed")}
    assert f"t3_{tree(broken)}/comments" in failed
    assert sum(key.endswith("/replies") for key in failed) == 1
    job = broken.job()
    status = job.done("status")["sources"]["reddit"]
    assert (status["incomplete_posts"], set(status["incomplete"])) == (
        3,
        {f"t3_{key}" for key in expected(broken)},
    )
    said = job.kb("status").stdout
    assert "3 incomplete posts: t3_" in said
    assert f"t3_{tree(broken)}" in said


def test_the_next_crawl_reads_what_was_left(broken: Work) -> None:
    broken.sandbox.faults.clear()
    assert broken.crawl()["incomplete_posts"] == 0
    filtered = broken.filter()
    assert (filtered["failed"], filtered["incomplete_posts"], unread(broken)) == (0, 0, {})
    assert filtered["crawled"] == len(broken.world.posts) + len(broken.world.comments)


def test_raw_alone_says_the_same(broken: Work, tmp_path: Path) -> None:
    broken.filter()
    broken.export()
    far = Work(broken.sandbox, tmp_path / "far", **broken.section)
    shutil.copytree(broken.root / "raw", far.root / "raw")
    far.filter()
    far.export()
    for path in sorted((broken.root / "release" / "reddit").glob("*.parquet")):
        assert path.read_bytes() == (far.root / "release" / "reddit" / path.name).read_bytes()


def test_a_shut_post_has_comments_that_nobody_could_read(work: Work) -> None:
    key = tree(work)
    work.sandbox.faults.add(
        f"^/comments/{key}/", status=403, body={"message": "no", "error": 403}, times=None
    )
    work.crawl()
    filtered = work.filter()
    assert (filtered["failed"], filtered["incomplete_posts"]) == (0, 0)
    assert unread(work) == {key: work.world.posts[key]["num_comments"]}


@pytest.fixture
def cut(work: Work) -> Work:
    """A chain of four whose second was deleted, made by hand."""
    things = [
        post("good", num_comments=4),
        comment("c1"),
        comment("c2", parent_id="t1_c1", body="[deleted]", author="[deleted]"),
        comment("c3", parent_id="t1_c2"),
        comment("c4", parent_id="t1_c3"),
    ]
    write(work.root, "listings", {}, listing(*things[:1]))
    page = [listing(things[0]), listing(*things[1:])]
    write(work.root, "comments", {"article": "good"}, page)
    work.filter()
    work.export()
    return work


def test_a_comment_says_whether_its_parent_is_there(cut: Work) -> None:
    for folder in ("clean", "release"):
        found = {
            row["comment_id"]: (row["parent_in_release"], row["depth"])
            for row in rows_of(cut, folder, "comments")
        }
        assert found == {"c1": (True, 0), "c3": (False, 2), "c4": (True, 3)}
    (row,) = cut.table("clean", "reddit", "posts")
    assert (row["comments_released"], row["comments_unread"]) == (3, 0)


def test_the_card_says_how_many_and_why(cut: Work) -> None:
    release(cut.run())
    for name in ("README.md", "DATASHEET.md"):
        text = (cut.root / "release" / "reddit" / name).read_text()
        assert "1 of 3 comments answer one that was left out" in text
        assert "deepest comment is at 3, the deepest that can be reached from its post" in text
    limits = (cut.root / "release" / "reddit" / "README.md").read_text().split("## Limits")[1]
    assert "Threads have gaps" in limits.split("## ")[0]


def test_a_purge_counts_again(cut: Work) -> None:
    ids = cut.place / "gone.txt"
    ids.write_text("t1_c3")
    cut.purge(ids)
    for folder in ("clean", "release"):
        comments = rows_of(cut, folder, "comments")
        there = {row["comment_id"]: row["parent_in_release"] for row in comments}
        assert there == {"c1": True, "c4": False}
        assert [row["comments_released"] for row in rows_of(cut, folder, "posts")] == [2]
    before = rows_of(cut, "clean", "posts")
    cut.filter()
    assert rows_of(cut, "clean", "posts") == before, "a filter says the same"


def test_a_purged_post_leaves_no_part_that_failed(broken: Work) -> None:
    broken.filter()
    ids = broken.place / "gone.txt"
    ids.write_text(f"t3_{tree(broken)}")
    broken.purge(ids)
    named = [path for path, text in broken.text().items() if tree(broken) in text]
    assert all("tombstones" in path for path in named)


def test_threads_of_a_real_size_can_be_walked_knowingly(whole: Work) -> None:
    """Every comment that says so has its parent, and no other."""
    comments = str(whole.root / "release" / "reddit" / "comments-*.parquet")
    wrong = duckdb.execute(
        "SELECT count(*) FROM read_parquet($1) c WHERE parent_in_release !="
        " (starts_with(parent_id, 't3_')"
        " OR EXISTS (FROM read_parquet($1) p WHERE 't1_' || p.comment_id = c.parent_id))",
        [comments],
    ).fetchall()
    assert wrong == [(0,)]
    cut = sum(not row["parent_in_release"] for row in whole.table("clean", "reddit", "comments"))
    assert cut, "the sandbox deletes and removes some"


def test_a_plan_waits_for_no_writer(tiny: Work, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KB_NOW", LATER)
    files = {path: path.stat().st_mtime_ns for path in tiny.root.rglob("*") if path.is_file()}
    with writer(tiny.root, "reddit"):
        planned = plan_refresh(tiny.run())
    del files[tiny.root / "state" / "reddit.lock"]
    assert planned["phases"][0]["items"] > 100
    assert {path: path.stat().st_mtime_ns for path in files} == files


NOON = datetime(2023, 1, 1, 12, tzinfo=UTC)


def test_a_post_without_a_body_is_a_passage_and_its_comments_follow(tmp_path: Path) -> None:
    posts = [
        {"post_id": key, "type": "text", "title": f"Title {key}", "created_utc": NOON}
        for key in ("a", "b")
    ]
    comment = {"comment_id": "c", "post_id": "a", "parent_id": "t3_a", "created_utc": NOON}
    write_table(tmp_path, "reddit/posts", posts)
    write_table(tmp_path, "reddit/comments", [{**comment, "body": "feed\nthe wolf"}])
    made = list(passages(load_profile("minecraft"), tmp_path))
    assert [(one.key, one.thing, one.title, one.text) for one in made] == [
        ("t3_a", "a", "Title a", ""),
        ("t1_c", "a", "Title a", "feed\nthe wolf"),
        ("t3_b", "b", "Title b", ""),
    ]
    assert made[1].url.endswith("/comments/a/_/c/")
    assert made[1].date == "2023-01-01"
