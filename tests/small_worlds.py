"""Sizes of the small worlds in which tests of several rooms run every command."""

from kb.sandbox.world import World

DEMO = {"n_channels": 9, "n_videos": 60, "n_posts": 24, "width": 30, "depth": 8}
ITEMS = {"youtube": "videos", "wiki": "pages", "reddit": "posts"}  # what a source counts


def small_world() -> World:
    """A world with every source, crawled in seconds."""
    return World(n_channels=9, n_videos=60, n_posts=24, width=120, depth=24)
