"""What released threads lack, measured on them: sentences for card and datasheet."""

from collections.abc import Iterator

from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleaseFolder
from kb.store.tables.reading import scan

# The longest chain of comments that can be walked from a post, each by its parent.
_WALK = """
    WITH RECURSIVE walk(name, steps) AS (
        SELECT 't1_' || comment_id, 0 FROM {c} WHERE starts_with(parent_id, 't3_')
        UNION ALL
        SELECT 't1_' || comment_id, steps + 1 FROM {c} JOIN walk ON parent_id = walk.name
    )
    SELECT max(steps) FROM walk"""


def gaps(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """Comments whose parent was left out, and comments that were never read."""
    yield from _cut(con, folder)
    yield from _unread(con, folder)


def _cut(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """Comments whose parent was left out."""
    if not (shards := folder.shards("comments")):
        return
    total, cut, deepest = con.execute(
        f"SELECT count(*), count(*) FILTER (NOT parent_in_release), max(depth) FROM {scan(shards)}"
    ).fetchone() or (0, 0, None)
    if not cut:
        return
    walked = (con.execute(_WALK.format(c=scan(shards))).fetchone() or (None,))[0]
    yield (
        f"Threads have gaps: {cut:,} of {total:,} comments answer one that was left out,"
        " because it was deleted, removed, dropped by a filter or not to be had"
        " (`parent_in_release` is false). `depth` is the true one: the deepest comment is at"
        f" {_at(deepest)}, the deepest that can be reached from its post along `parent_id`"
        f" at {_at(walked)}."
    )


def _unread(con: DuckDBPyConnection, folder: ReleaseFolder) -> Iterator[str]:
    """Comments that were never read."""
    if not (shards := folder.shards("posts")):
        return
    posts, unread = con.execute(
        f"SELECT count(*), sum(comments_unread) FROM {scan(shards)} WHERE comments_unread > 0"
    ).fetchone() or (0, 0)
    if not posts:
        return
    yield (
        f"{unread:,} comments of {posts:,} posts are known to exist and were not read,"
        " because the source did not answer or was not asked for them (`comments_unread`)."
    )


def _at(depth: int | None) -> str:
    return "none" if depth is None else f"{depth:,}"
