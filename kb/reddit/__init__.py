"""Reddit: posts and comments of one subreddit, live (PRAW) or from archive dumps.

import kb.reddit
for row in kb.reddit.reconstruct("t3_ids.txt"): ...     # Post, Comment or Missing
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kb.reddit.restore.reconstruct import Comment, Missing, Post, reconstruct

__all__ = ["Comment", "Missing", "Post", "reconstruct"]


def __getattr__(name: str) -> Any:
    """Loaded when asked for, so that `kb --help` stays quick."""
    if name in __all__:
        from kb.reddit.restore import reconstruct as module

        return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
