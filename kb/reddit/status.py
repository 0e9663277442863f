"""What `kb status` says about Reddit: posts of which a part of the tree could not be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kb.reddit.connector.reduce import crawled
from kb.reddit.connector.unfinished import incomplete_posts

__all__ = ["crawled", "incomplete"]

_NAMED = 20  # posts that are named


def incomplete(root: Path) -> dict[str, Any]:
    """How many posts are incomplete, as summaries count them, and the names of some."""
    keys = sorted(incomplete_posts(root))
    return {"incomplete_posts": len(keys), "incomplete": [f"t3_{key}" for key in keys[:_NAMED]]}
