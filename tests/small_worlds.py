"""Sizes of the small worlds in which tests of several rooms run every command."""

DEMO = {"n_channels": 9, "n_videos": 60, "n_posts": 24, "width": 30, "depth": 8}
ITEMS = {"youtube": "videos", "wiki": "pages", "reddit": "posts"}  # what a source counts
