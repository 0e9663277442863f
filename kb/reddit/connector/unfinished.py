"""What the state of a crawl tells: which parts of posts were not read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from kb.reddit.connector.reduce import OUTSIDE, PAYLOADS
from kb.store import reading
from kb.store.frontier import Frontier
from kb.store.layout import Layout

COMMENTS, REPLIES = "comments", "replies"  # parts that failed, behind the name of what they are of


def unread_parts(frontier: Frontier) -> dict[str, str]:
    """Posts of which a part of the tree failed after its tries: bare id → the reason of one part.

    The next crawl tries the part again.
    """
    found: dict[str, str] = {}
    for key, _, reason, _ in frontier.items("tree", "error"):
        found.setdefault(key, reason or "failed")
    for key, _, reason, _ in frontier.items("thread", "error"):
        found.setdefault(key.partition("/")[0], reason or "failed")
    for _, _, reason, payload in frontier.items("more", "error"):
        found.setdefault(payload.post, reason or "failed")
    return found


def incomplete_posts(root: Path) -> dict[str, str]:
    """The same of a data root; nothing where no crawl was."""
    path = Layout(root).state("reddit")
    if not path.exists():
        return {}
    with reading.state(path, PAYLOADS) as frontier:
        return unread_parts(frontier)


def incomplete(root: Path) -> dict[str, int]:
    """For summaries: how many posts have a part that could not be read."""
    return {"incomplete_posts": len(incomplete_posts(root))}


def gave_up(root: Path) -> Iterator[tuple[str, str]]:
    """(key, reason) of what failed after its tries, or is shut: `failed` in the filter where no
    answer tells of it.

    A key is a full name. Where a page failed it is the name of what the page is of and what was to
    be on it: `t3_…/comments`, `t1_…/replies`; the post or comment itself may well be kept.
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
