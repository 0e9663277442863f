"""`data.thread(post_id)`: a post and its nested comments, with comments whose parent is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from kb.core import terminal
from kb.core.errors import UsageError
from kb.reader import html
from kb.reader.tables import OpenTables

_TEXT = 400  # characters of a body in a notebook
_SHOWN = 100  # comments in a notebook
_POST = ("title", "body", "author_hash", "source_url")
_COMMENT = ("body", "author_hash")


@dataclass(eq=False, repr=False)
class ThreadComment:
    """A comment and the answers to it, oldest first.

    `depth` is 0 for answers to the post, and None if unknown. `body` is None if the text is not
    available; `missing` is then the reason why it could not be restored, if known.
    """

    comment_id: str
    parent_id: str
    depth: int | None
    score: int | None
    created_utc: datetime
    body: str | None = None
    author_hash: str | None = None
    missing: str | None = None
    replies: list[ThreadComment] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<comment {self.comment_id}: {self.score} points, {len(self.replies)} replies>"


@dataclass(eq=False, repr=False)
class Thread:
    """A post, the answers to it, and comments whose parent is missing (deleted or filtered out).

    thread = data.thread("abc123")
    thread.title, thread.body           # None without texts
    thread.replies[0].replies           # nested
    thread.orphans                      # each with its own replies
    for level, comment in thread.walk(): ...
    """

    post: dict[str, Any]
    replies: list[ThreadComment]
    orphans: list[ThreadComment]
    missing: str | None = None

    @property
    def post_id(self) -> str:
        """The bare id of the post."""
        return str(self.post["post_id"])

    @property
    def title(self) -> str | None:
        """The post's title, if available."""
        return self.post.get("title")

    @property
    def body(self) -> str | None:
        """The post's own text, if it has one and it is available."""
        return self.post.get("body")

    def walk(self) -> Iterator[tuple[int, ThreadComment]]:
        """(level, comment) from the top; orphans come last, starting at level 0."""
        waiting = [(0, comment) for comment in reversed([*self.replies, *self.orphans])]
        while waiting:
            level, comment = waiting.pop()
            yield level, comment
            waiting += [(level + 1, reply) for reply in reversed(comment.replies)]

    def __len__(self) -> int:
        """The number of available comments."""
        return sum(1 for _ in self.walk())

    def __bool__(self) -> bool:
        return True  # even without comments

    def __str__(self) -> str:
        lines = [f"{self.post_id} ({self.post['score']}) {_line(self.title, self.missing)}"]
        first = self.orphans[0] if self.orphans else None
        for level, comment in self.walk():
            if comment is first:
                lines.append(f"-- {_orphans(len(self.orphans))}")
            text = _line(comment.body, comment.missing)
            lines.append(f"{'  ' * (level + 1)}{comment.comment_id} ({comment.score}) {text}")
        return "\n".join(line.rstrip() for line in lines)

    def __repr__(self) -> str:
        orphans = f", {len(self.orphans)} of them orphans" if self.orphans else ""
        return f"<thread {self.post_id}: {len(self)} comments{orphans}>"

    def _repr_html_(self) -> str:
        parts = [
            (
                f"<b>{html.text(self.title or self.post_id, _TEXT)}</b> "
                f"<small>{html.text(self.post['score'])} points,"
                f" {html.count(len(self), 'comment')}"
                f"</small><div>{html.text(self.body, _TEXT)}</div>"
            )
        ]
        first = self.orphans[0] if self.orphans else None
        for number, (level, comment) in enumerate(self.walk()):
            if number == _SHOWN:
                parts.append(f"<div><i>and {len(self) - _SHOWN:,} more</i></div>")
                break
            if comment is first:
                parts.append(f"<div><i>{html.text(_orphans(len(self.orphans)))}</i></div>")
            text = html.text(comment.body if comment.body is not None else comment.missing, _TEXT)
            parts.append(
                f'<div style="margin-left:{min(level, 20) * 1.5:.1f}em">'
                f"<small>{html.text(comment.comment_id)}, {html.text(comment.score)} points"
                f"</small> {text}</div>"
            )
        return html.block("".join(parts))


def find(opened: OpenTables, post_id: str) -> Thread:
    """The thread of a post, by its bare id or full name. Raises UsageError if it is unknown."""
    key = post_id.removeprefix("t3_")
    # Content that a later release removed stays out of an older copy.
    removed = _reasons(opened, "reddit_tombstones")
    for spine in opened.ranked("reddit_posts"):
        rows = opened.rows(f"FROM {spine.full} WHERE post_id = ?", [key]).to_pylist()
        if not rows:
            continue
        if f"t3_{key}" in removed:
            raise UsageError(f"the post {key} was removed: {removed[f't3_{key}']}")
        missing = _reasons(opened, "reddit_missing")
        post = _filled(opened, rows, "reddit_posts", "post_id", _POST, key)[0]
        table = f"{spine.schema}.reddit_comments"
        sql = f"FROM {table} WHERE post_id = ? ORDER BY created_utc, comment_id"
        comments = [
            row
            for row in (opened.rows(sql, [key]).to_pylist() if table in opened else [])
            if f"t1_{row['comment_id']}" not in removed
        ]
        filled = _filled(opened, comments, "reddit_comments", "comment_id", _COMMENT, key)
        return _nested(post, filled, missing)
    if not opened.ranked("reddit_posts"):
        raise UsageError(
            "the data contain no posts", hint="load a Reddit release or a data root with one"
        )
    raise UsageError(
        f"unknown post {key!r}",
        hint='data["reddit_posts"] lists the ids; rejected posts are not included',
    )


def _filled(
    opened: OpenTables,
    rows: list[dict[str, Any]],
    short: str,
    key: str,
    names: tuple[str, ...],
    post_id: str,
) -> list[dict[str, Any]]:
    """Rows with their texts, from the restored table if their own has none."""
    if not rows or names[-1] in rows[0] or f"restored.{short}" not in opened:
        return rows
    chosen = ", ".join([key, *names])
    restored = opened.rows(f"SELECT {chosen} FROM restored.{short} WHERE post_id = ?", [post_id])
    texts = {row[key]: row for row in restored.to_pylist()}
    return [row | texts.get(row[key], {}) for row in rows]


def _reasons(opened: OpenTables, short: str) -> dict[str, str]:
    """Keys with their reasons, from every table of this name."""
    reasons: dict[str, str] = {}
    for view in opened.ranked(short):
        for row in opened.rows(f"SELECT key, reason FROM {view.full}").to_pylist():
            reasons[row["key"]] = row["reason"]
    return reasons


def _nested(post: dict[str, Any], rows: list[dict[str, Any]], missing: dict[str, str]) -> Thread:
    every = {
        f"t1_{row['comment_id']}": ThreadComment(
            row["comment_id"],
            row["parent_id"],
            row["depth"],
            row["score"],
            row["created_utc"],
            row.get("body"),
            row.get("author_hash"),
            missing.get(f"t1_{row['comment_id']}"),
        )
        for row in rows
    }
    name = f"t3_{post['post_id']}"
    thread = Thread(post, [], [], missing.get(name))
    for level, key in reading_order(
        {key: comment.parent_id for key, comment in every.items()}, name
    ):
        comment = every[key]
        top = thread.replies if comment.parent_id == name else thread.orphans
        (every[comment.parent_id].replies if level else top).append(comment)
    return thread


def reading_order(parents: Mapping[str, str | None], post: str) -> Iterator[tuple[int, str]]:
    """(level, name) of each comment behind what it answers; level 0 answers the post. At the end
    come those whose parent is not there with their answers, then parents that form a cycle.
    """
    answers: dict[str | None, list[str]] = {}
    for name, parent in parents.items():
        is_there = parent == post or (parent in parents and parent != name)
        answers.setdefault(parent if is_there else None, []).append(name)
    reached = set[str]()
    waiting = [(0, name) for name in reversed([*answers.get(post, ()), *answers.get(None, ())])]
    while waiting:
        level, name = waiting.pop()
        reached.add(name)
        yield level, name
        waiting += [(level + 1, answer) for answer in reversed(answers.get(name, []))]
    yield from ((0, name) for name in parents if name not in reached)


def _line(text: str | None, missing: str | None) -> str:
    if text is None:
        return f"[{missing}]" if missing else ""
    return terminal.one_line(" ".join(text.split()))


def _orphans(number: int) -> str:
    are = "1 comment whose parent is" if number == 1 else f"{number:,} comments whose parents are"
    return f"{are} missing (deleted or filtered out)"
