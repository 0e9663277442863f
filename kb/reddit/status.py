"""Which parts of posts a crawl could not read, for `kb status`, summaries and the filter."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.reddit.crawl.reduce import OUTSIDE, PAYLOADS, incomplete_posts
from kb.store.layout import Layout
from kb.store.tables import reading

COMMENTS, REPLIES = "comments", "replies"  # parts that failed, behind the name of what they are of
_NAMED = 20  # posts that `kb status` names


def incomplete(root: Path) -> dict[str, Any]:
    """How many posts of a data root are incomplete, and the names of some."""
    path = Layout(root).state("reddit")
    keys: list[str] = []
    if path.exists():
        with reading.state(path, PAYLOADS) as frontier:
            keys = sorted(incomplete_posts(frontier))
    return {"incomplete_posts": len(keys), "incomplete": [f"t3_{key}" for key in keys[:_NAMED]]}


def incomplete_count(root: Path) -> dict[str, int]:
    return {"incomplete_posts": incomplete(root)["incomplete_posts"]}


def failures(root: Path) -> Iterator[tuple[str, str]]:
    """(key, reason) of everything that failed after its tries or is private: `failed` in the filter
    where no answer has it.

    A key is a full name. Where a page failed it is the name of the page's subject and the part that
    is missing: `t3_…/comments`, `t1_…/replies`; the post or comment itself may be kept.
    """
    path = Layout(root).state("reddit")
    if not path.exists():
        return
    with reading.state(path, PAYLOADS) as frontier:
        for key, _, reason, _ in frontier.items("more", "error"):
            yield f"t1_{key}", reason or "failed"
        for key, _, reason, _ in frontier.items("thread", "error"):
            yield f"t1_{key.partition('/')[2]}/{REPLIES}", reason or "failed"
        for key, _, reason, _ in frontier.items("tree", "error"):
            yield f"t3_{key}/{COMMENTS}", reason or "failed"
        for key, _, reason, _ in frontier.items("tree", "skipped"):
            if reason not in (OUTSIDE, "purged", "404", "410"):
                yield f"t3_{key}", reason or "failed"
