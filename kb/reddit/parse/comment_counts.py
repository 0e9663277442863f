"""How whole a thread is: what of a post's tree was not read, and what of it a table holds.

What is unread follows from the raw answers alone, so that the same answers give the same tables on
every machine: stubs whose comments never came, threads whose page was never answered, and what
Reddit counts beyond what was read where the post's own page is not there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import default_workers
from kb.core.engine import make_threads
from kb.reddit.parse.answers import OPEN, READ
from kb.store import parquet
from kb.store.layout import parquet_files
from kb.store.reading import reading
from kb.store.shards import write_table

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
    told = pc.add(_count(posts, stubs), _count(posts, opened))
    beyond = pc.subtract(posts["num_comments"], _count(posts, known))
    whole = pc.and_(pc.is_in(posts["fullname"], read), pc.equal(told, 0))
    unread = pc.if_else(whole, 0, pc.max_element_wise(told, beyond))
    return posts.append_column("comments_unread", unread)


def counted(kept: dict[str, pa.Table]) -> dict[str, pa.Table]:
    """Kept posts and comments with `comments_released` and `parent_in_release`; both of the same
    posts.
    """
    posts, comments = (kept.get(f"reddit/{name}") for name in _NAMES)
    found = dict(kept)
    if comments is not None:
        ids = comments["comment_id"].combine_chunks()
        parent = comments["parent_id"]
        there = pc.is_in(pc.utf8_slice_codeunits(parent, 3), ids)
        # Every comment's post is there: the stage `post` saw to it.
        there = pc.or_(pc.starts_with(parent, "t3_"), there)
        found["reddit/comments"] = _with(comments, "parent_in_release", there)
    if posts is not None:
        below: pa.Array[Any] | pa.ChunkedArray[Any] = (
            pa.chunked_array([pa.repeat(pa.scalar(0, pa.int64()), posts.num_rows)])
            if comments is None
            else _count(posts, comments)
        )
        found["reddit/posts"] = _with(posts, "comments_released", below)
    return found


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
        for kind, rows in counted(old).items():
            if not rows.equals(old[kind]):
                column = _COUNTED[kind][-1]
                whole = _with(parquet.read_table(paths[kind]), column, rows[column])
                write_table(paths[kind], whole, kind)


def _count(posts: pa.Table, below: pa.Table) -> pa.Array[Any]:
    """How many rows of `below` each post has."""
    sums = below.group_by("post_id").aggregate([([], "count_all")])
    place = pc.index_in(posts["post_id"], sums["post_id"].combine_chunks())
    found = sums["count_all"].combine_chunks().take(place.combine_chunks())
    counts: pa.Array[Any] = pc.fill_null(found, 0)
    return counts


def _with(rows: pa.Table, name: str, values: pa.Array[Any] | pa.ChunkedArray[Any]) -> pa.Table:
    if name in rows.column_names:
        return rows.set_column(rows.column_names.index(name), name, values)
    return rows.append_column(name, values)
