"""Threads as documents for language models: title, body, then the comments as a nested list, a
level a depth. The Markdown of authors stays as it is.

What was answered and is not there itself stands as `[deleted]`; what is above that, and so is not
known, as `[…]`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.export.text import TextDocument, TextFiles, TextPiece
from kb.store.tables import parquet

Row = dict[str, Any]

GONE, UNKNOWN = "[deleted]", "[…]"
_POST = (
    *("post_id", "type", "title", "body", "poll_options", "source_url", "created_utc"),
    *("fetched_at", "score", "num_comments", "comments_released"),
)
_COMMENT = ("comment_id", "post_id", "parent_id", "depth", "created_utc", "body")


def documents(files: TextFiles, subreddit: str) -> Iterator[TextDocument]:
    """The kept posts of one bucket with their comments; `subreddit` is its address. Raises
    DamagedData.
    """
    comments: dict[str, list[Row]] = {}
    for path in files["reddit/comments"]:
        for row in parquet.read_table(path, _COMMENT).to_pylist():
            comments.setdefault(row["post_id"], []).append(row)
    (posts,) = files["reddit/posts"]
    with parquet.open_file(Path(posts)) as file:
        for batch in file.iter_batches(columns=list(_POST)):
            for post in batch.to_pylist():
                options = "\n".join(f"- {option}" for option in post["poll_options"] or ())
                own = [text for text in (post["body"], options) if text and text.strip()]
                more = ("type", "score", "num_comments", "comments_released", "source_url")
                yield TextDocument(
                    post["post_id"],
                    post["title"] or "",
                    [
                        *(TextPiece(text.strip("\n")) for text in own),
                        *thread(post["post_id"], comments.get(post["post_id"], [])),
                    ],
                    post["fetched_at"],
                    post["created_utc"],
                    {
                        "url": f"{subreddit}comments/{post['post_id']}/",
                        "license": None,
                        **{name: post[name] for name in more},
                    },
                )


def thread(post: str, comments: list[Row]) -> Iterator[TextPiece]:
    """The comments of a post, each after what it answers, by time."""
    there = {comment["comment_id"] for comment in comments}
    replies: dict[str, list[Row]] = {}
    absent: dict[str, int] = {}  # what is not there → its depth
    for comment in sorted(
        comments, key=lambda comment: (comment["created_utc"], comment["comment_id"])
    ):
        kind, _, parent = comment["parent_id"].partition("_")
        replies.setdefault("" if kind == "t3" or parent == post else parent, []).append(comment)
        if kind != "t3" and parent not in there and parent != post:
            absent.setdefault(parent, max((comment["depth"] or 1) - 1, 0))
    passed: set[str] = set()

    def below(parent: str, depth: int) -> Iterator[TextPiece]:
        waiting = [(reply, depth) for reply in reversed(replies.get(parent, ()))]
        while waiting:
            comment, level = waiting.pop()
            if comment["comment_id"] in passed:
                continue
            passed.add(comment["comment_id"])
            yield _item(comment["body"], level, begins=True)
            under = replies.get(comment["comment_id"], ())
            waiting += [(reply, level + 1) for reply in reversed(under)]

    yield from below("", 0)
    for parent, depth in absent.items():
        for level in range(depth):
            yield _item(UNKNOWN, level, begins=not level)
        yield _item(GONE, depth, begins=not depth)
        yield from (
            item._replace(begins=bool(number))
            for number, item in enumerate(below(parent, depth + 1))
        )
    for comment in comments:  # that answer each other in a circle
        if comment["comment_id"] not in passed:
            yield _item(comment["body"], 0, begins=True)


def _item(body: str, depth: int, begins: bool) -> TextPiece:
    indent = "  " * (depth + 1)
    lines = [f"{indent}{line}" if line.strip() else "" for line in body.strip("\n").split("\n")]
    return TextPiece(
        f"{'  ' * depth}- {lines[0].lstrip()}" + "".join(f"\n{line}" for line in lines[1:]), begins
    )
