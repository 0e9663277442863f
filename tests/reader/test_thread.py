"""Threads, with and without texts."""

import shutil
from pathlib import Path
from typing import Any

import duckdb
import pytest

import kb
from kb.artifacts.release_folder import tombstone_lines
from kb.core.errors import UsageError
from kb.store.state import tombstones
from kb.store.tables.shard_writer import write_table


def direct(sql: str) -> list[tuple[Any, ...]]:
    return duckdb.sql(sql).fetchall()


def literal(path: Path) -> str:
    return "'" + str(path).replace("[", "[[]") + "'"


def orphaned(release: Path) -> str:
    """A post with a comment whose parent was left out."""
    pattern = literal(release / "reddit" / "comments-*.parquet")
    return str(direct(f"SELECT min(post_id) FROM {pattern} WHERE NOT parent_in_release")[0][0])


def test_a_thread_has_every_comment_once_under_its_parent(release: Path) -> None:
    data = kb.load(release)
    post = orphaned(release)
    thread = data.thread(f"t3_{post}")
    pattern = literal(release / "reddit" / "comments-*.parquet")
    rows = direct(
        f"SELECT comment_id, parent_id, parent_in_release FROM {pattern} WHERE post_id = '{post}'"
    )
    assert sorted(one.comment_id for _, one in thread.walk()) == sorted(row[0] for row in rows)
    assert {one.comment_id for one in thread.orphans} == {row[0] for row in rows if not row[2]}
    parents = {row[0]: row[1] for row in rows}
    for _, one in thread.walk():
        for reply in one.replies:
            assert parents[reply.comment_id] == f"t1_{one.comment_id}"
    assert {parents[one.comment_id] for one in thread.replies} <= {f"t3_{post}"}
    assert thread.title is None
    assert all(one.body is None for _, one in thread.walk())
    assert "missing (deleted or filtered out)" in str(thread)
    assert "missing (deleted" in thread._repr_html_()


def test_texts_come_from_clean_or_from_what_was_restored(
    release: Path, root: Path, tmp_path: Path
) -> None:
    post = orphaned(release)
    clean = kb.load(root).thread(post)
    assert clean.title
    assert all(one.body for _, one in clean.walk())
    restored = kb.load(release, root / "export" / "reconstructed").thread(post)
    assert str(restored) == str(clean)
    # What a later release removed stays out of an older copy of its texts.
    first = clean.replies[0]
    shutil.copytree(release / "reddit", tmp_path / "release" / "reddit")
    tombstones.add(tmp_path, "reddit", [(f"t1_{first.comment_id}", "deleted")])
    lines = tombstone_lines(tombstones.read(tmp_path, "reddit"))
    (tmp_path / "release" / "reddit" / "tombstones.ndjson").write_text(lines)
    (tmp_path / "release" / "reddit" / "SHA256SUMS").unlink()
    later = kb.load(tmp_path / "release", root / "export" / "reconstructed").thread(post)
    assert first.comment_id not in str(later)
    assert first.body not in later._repr_html_()
    assert {one.comment_id for one in first.replies} <= {one.comment_id for one in later.orphans}
    tombstones.add(tmp_path, "reddit", [(f"t3_{post}", "deleted")])
    with pytest.raises(UsageError, match="was removed: deleted"):
        kb.load(tmp_path).thread(post)


def test_parents_that_lead_round_in_a_circle_are_orphans(tmp_path: Path, make_rows) -> None:
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    given = {"comment_id": ["a", "b", "c"], "post_id": ["p"] * 3}
    given |= {"parent_id": ["t1_b", "t1_a", "t1_c"]}
    comments = make_rows("reddit/comments", 3, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert sorted(one.comment_id for _, one in thread.walk()) == ["a", "b", "c"]
    assert len(thread.orphans) == 3


def test_a_deep_thread_has_no_limit(tmp_path: Path, make_rows) -> None:
    posts = make_rows("reddit/posts", 1, post_id=["p"])
    write_table(tmp_path / "clean/reddit/posts/part-0.parquet", posts, "reddit/posts")
    parents = ["t3_p", *(f"t1_c{at:05d}" for at in range(2_999))]
    given = {"comment_id": [f"c{at:05d}" for at in range(3_000)], "post_id": ["p"] * 3_000}
    comments = make_rows("reddit/comments", 3_000, parent_id=parents, **given)
    write_table(tmp_path / "clean/reddit/comments/part-0.parquet", comments, "reddit/comments")
    thread = kb.load(tmp_path).thread("p")
    assert [level for level, _ in thread.walk()] == list(range(3_000))
    assert "and 2,900 more" in thread._repr_html_()
