"""Newest rows of things → posts and comments as the stages judge them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import default_workers
from kb.core.engine import make_threads
from kb.reddit.parse.answer_tree import depths
from kb.reddit.parse.answers import KINDS, MARKS, OPEN, READ, schema
from kb.store.layout import parquet_files
from kb.store.tables import parquet
from kb.store.tables.columns import newest, put
from kb.store.tables.reading import reading
from kb.store.tables.shard_writer import write_table

# Columns that the stages read and no table has, or only one of the two tables.
HELPERS = (
    "fullname",
    "state",
    "live",
    "missing",
    "gone",
    "gone_value",
    "undated",
    "over_18",
    "orphan",
    "post",
    "title",
    "type",
    "link_kind",
    "source_url",
    "is_crosspost",
    "poll_options",
    "num_comments",
    "upvote_ratio",
    "parent_id",
)


def assemble(newest: dict[str, pa.Table]) -> dict[str, pa.Table]:
    """Posts and comments of one bucket.

    Of several kinds of answers the newest about a thing counts; a stub only where nothing else is
    known. A comment is an `orphan` when nothing is known of its post.
    """
    things = newest_of(newest)
    is_post = pc.starts_with(things["fullname"], "t3_")
    posts, comments = things.filter(is_post), things.filter(pc.invert(is_post))
    named = [part.select(["fullname", "post_id", "state"]) for part in newest.values()]
    states = pa.concat_tables(named)
    marks = states.filter(pc.is_in(states["state"], value_set=pa.array(MARKS)))
    posts = with_unread(posts, comments, marks)
    posts = _named(posts)
    return {"reddit/posts": posts, "reddit/comments": _comments(_named(comments), posts)}


def with_posts(comments: pa.Table, kept: Mapping[str, pa.Table]) -> pa.Table:
    """Comments with `post`: null when their post is kept, else why it is not."""
    good = pc.is_in(comments["post_id"], value_set=_ids(kept.get("reddit/posts")))
    why = pc.if_else(comments["orphan"], "absent", "not_kept")
    return comments.append_column("post", pc.if_else(good, pa.scalar(None, pa.string()), why))


def newest_of(answers: dict[str, pa.Table]) -> pa.Table:
    """One row a thing over all kinds of answers, sorted by full name; marks are no things."""
    tables = [
        answers[kind]
        .select(schema().names)
        .append_column("rank", pa.repeat(pa.scalar(rank, pa.int8()), answers[kind].num_rows))
        for rank, kind in enumerate(KINDS)
        if kind in answers
    ]
    rows = pa.concat_tables(tables)
    rows = rows.filter(pc.invert(pc.is_in(rows["state"], value_set=pa.array(MARKS))))
    rows = rows.append_column("real", pc.not_equal(rows["state"], "stub"))
    latest = newest(rows, ["fullname"], ["real", "fetched_at", "rank"])
    return latest.drop_columns(["rank", "real"]).combine_chunks()


def _named(rows: pa.Table) -> pa.Table:
    """The columns that both tables share: `missing`, `score_source`, and the text as `body`."""
    state = rows["state"]
    rows = rows.append_column("missing", pc.equal(state, "missing"))
    # What has no id has no state either: why is in its problems.
    known = pc.if_else(pc.equal(state, "unknown"), pa.scalar(None, pa.string()), state)
    rows = put(rows, "state", known)
    rows = rows.append_column("score_source", pc.if_else(rows["live"], "live", "dump"))
    rows = rows.drop_columns(["dump"])
    return rows.rename_columns(["body" if name == "text" else name for name in rows.column_names])


def _comments(rows: pa.Table, posts: pa.Table) -> pa.Table:
    rows = rows.append_column("comment_id", pc.utf8_slice_codeunits(rows["fullname"], 3))
    keys = cast("list[str]", rows["comment_id"].to_pylist())
    known = depths(zip(keys, rows["parent_id"].to_pylist(), strict=True))
    rows = rows.append_column("depth", pa.array([known.get(key) for key in keys], pa.int64()))
    rows = rows.append_column("parent_comment_id", parent_comments(rows["parent_id"]))
    there = pc.is_in(rows["post_id"], value_set=_ids(posts))
    return rows.append_column("orphan", pc.invert(there))


def parent_comments(parents: pa.ChunkedArray[Any]) -> pa.ChunkedArray[Any]:
    """The bare ids of those parents that are comments; null for posts."""
    bare = pc.utf8_slice_codeunits(parents, 3)
    return pc.if_else(pc.starts_with(parents, "t1_"), bare, pa.scalar(None, pa.string()))


def _ids(posts: pa.Table | None) -> pa.Array[Any]:
    return pa.array([], pa.string()) if posts is None else posts["post_id"].combine_chunks()


_NAMES = ("posts", "comments")
_COUNTED = {  # the columns that a count is made of, and the count
    "reddit/posts": ("post_id", "comments_released"),
    "reddit/comments": ("comment_id", "post_id", "parent_id", "parent_in_release"),
}


def with_unread(posts: pa.Table, comments: pa.Table, marks: pa.Table) -> pa.Table:
    """`posts` with the column `comments_unread`.

    `comments` are the newest rows of things with `fullname, post_id, state, parent_id`; `marks`
    rows of `fullname, post_id, state` as kb.reddit.parse.answers makes them.
    """
    read = marks["fullname"].filter(pc.equal(marks["state"], READ)).combine_chunks()
    stubs = comments.filter(pc.equal(comments["state"], "stub"))
    known = comments.filter(pc.is_in(comments["state"], pa.array(["there", "missing"])))
    opened = marks.filter(pc.equal(marks["state"], OPEN))
    # A dump may have brought the replies that no page was asked for.
    for answered in (read, known["parent_id"].combine_chunks()):
        opened = opened.filter(pc.invert(pc.is_in(opened["fullname"], answered)))
    opened = opened.group_by(["fullname", "post_id"]).aggregate([])
    announced = pc.add(_count(posts, stubs), _count(posts, opened))
    beyond = pc.subtract(posts["num_comments"], _count(posts, known))
    complete = pc.and_(pc.is_in(posts["fullname"], read), pc.equal(announced, 0))
    unread = pc.if_else(complete, 0, pc.max_element_wise(announced, beyond))
    return posts.append_column("comments_unread", unread)


def with_counts(kept: dict[str, pa.Table]) -> dict[str, pa.Table]:
    """Kept posts and comments with `comments_released` and `parent_in_release`; both of the same
    posts.
    """
    posts, comments = (kept.get(f"reddit/{name}") for name in _NAMES)
    tables = dict(kept)
    if comments is not None:
        ids = comments["comment_id"].combine_chunks()
        parent = comments["parent_id"]
        there = pc.is_in(pc.utf8_slice_codeunits(parent, 3), ids)
        # Every comment's post is there: the stage `post` saw to it.
        there = pc.or_(pc.starts_with(parent, "t3_"), there)
        tables["reddit/comments"] = put(comments, "parent_in_release", there)
    if posts is not None:
        below: pa.Array[Any] | pa.ChunkedArray[Any] = (
            pa.chunked_array([pa.repeat(pa.scalar(0, pa.int64()), posts.num_rows)])
            if comments is None
            else _count(posts, comments)
        )
        tables["reddit/posts"] = put(posts, "comments_released", below)
    return tables


def count_again(folder: Path) -> None:
    """After rows were taken out of the tables below `folder`: their counts, part by part.

    Parts of both tables with one number are of the same posts. A part that says the right thing
    stays as it is.
    """
    names = sorted({path.name for kind in _NAMES for path in parquet_files(folder / kind)})
    # Reading and compressing let other threads run.
    with make_threads(default_workers()) as pool:
        for _ in pool.map(lambda name: _count_again(folder, name), names):
            pass


def _count_again(folder: Path, name: str) -> None:
    paths = {f"reddit/{kind}": folder / kind / name for kind in _NAMES}
    paths = {kind: path for kind, path in paths.items() if path.exists()}
    with reading(paths.values()):
        old = {kind: parquet.read_table(path, _COUNTED[kind]) for kind, path in paths.items()}
        for kind, rows in with_counts(old).items():
            if not rows.equals(old[kind]):
                column = _COUNTED[kind][-1]
                updated = put(parquet.read_table(paths[kind]), column, rows[column])
                write_table(paths[kind], updated, kind)


def _count(posts: pa.Table, below: pa.Table) -> pa.Array[Any]:
    """How many rows of `below` each post has."""
    sums = below.group_by("post_id").aggregate([([], "count_all")])
    place = pc.index_in(posts["post_id"], sums["post_id"].combine_chunks())
    counted = sums["count_all"].combine_chunks().take(place.combine_chunks())
    return pc.fill_null(counted, 0)
