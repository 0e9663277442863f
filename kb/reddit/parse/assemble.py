"""Newest rows of things → posts and comments as the stages judge them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.reddit.parse import comment_counts as threads
from kb.reddit.parse.answers import KINDS, MARKS, schema
from kb.reddit.parse.tree import depths
from kb.store.newest import newest

# Columns that the stages read and no table has, or only one of the two tables.
HELPERS = (
    "fullname",
    "state",
    "live",
    "missing",
    "gone",
    "gone_value",
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
    found = newest_of(newest)
    is_post = pc.starts_with(found["fullname"], "t3_")
    posts, comments = found.filter(is_post), found.filter(pc.invert(is_post))
    posts = threads.with_unread(posts, comments, _marks(newest))
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
    found = newest(rows, ["fullname"], ["real", "fetched_at", "rank"])
    return found.drop_columns(["rank", "real"]).combine_chunks()


def _marks(newest: dict[str, pa.Table]) -> pa.Table:
    """Which parts of trees are known, of all kinds of answers."""
    rows = pa.concat_tables(
        [found.select(["fullname", "post_id", "state"]) for found in newest.values()]
    )
    return rows.filter(pc.is_in(rows["state"], value_set=pa.array(MARKS)))


def _named(rows: pa.Table) -> pa.Table:
    """The columns that both tables share: `missing`, `score_source`, and the text as `body`."""
    state = rows["state"]
    rows = rows.append_column("missing", pc.equal(state, "missing"))
    # What has no id has no state either: why is in its problems.
    rows = rows.set_column(
        rows.column_names.index("state"),
        "state",
        pc.if_else(pc.equal(state, "unknown"), pa.scalar(None, pa.string()), state),
    )
    rows = rows.append_column("score_source", pc.if_else(rows["live"], "live", "dump"))
    rows = rows.drop_columns(["dump"])
    return rows.rename_columns(["body" if name == "text" else name for name in rows.column_names])


def _comments(rows: pa.Table, posts: pa.Table) -> pa.Table:
    rows = rows.append_column("comment_id", pc.utf8_slice_codeunits(rows["fullname"], 3))
    keys = cast("list[str]", rows["comment_id"].to_pylist())
    known = depths(zip(keys, rows["parent_id"].to_pylist(), strict=True))
    rows = rows.append_column("depth", pa.array([known.get(key) for key in keys], pa.int64()))
    there = pc.is_in(rows["post_id"], value_set=_ids(posts))
    return rows.append_column("orphan", pc.invert(there))


def _ids(posts: pa.Table | None) -> pa.Array[Any]:
    return pa.array([], pa.string()) if posts is None else posts["post_id"].combine_chunks()
