"""Entities and links: what the profile's keywords name, and where the three sources speak of it.

The paper's three sources lie side by side; here each keyword leads to its wiki page, its videos
with the second, and its threads. Words are matched as for the pairs (pipelines/pairs.py).

    names      titles and redirects of the wiki's pages, from its raw answers
    build      clean/ → links/*.parquet
    release    links/ → release/links/: ids and counts
"""

from __future__ import annotations

from collections.abc import Mapping

from kb.core.context import Run
from kb.core.verdict import Summary
from kb.export import parquet
from kb.links.build import build
from kb.links.named import Names
from kb.store.layout import Layout
from kb.wiki import named


def links(run: Run) -> Summary:
    """Make the entity tables, then their release."""
    made = build(run, lambda: names(run))
    parquet.export(run, "links")
    return Summary(made, release=str(Layout(run.root).release("links")))


def names(run: Run) -> Mapping[str, Names]:
    """What the wiki calls its pages, by title."""
    return {
        page.title: Names(
            page.title.removeprefix(f"{page.prefix}:"),
            tuple(title.removeprefix(f"{page.prefix}:") for title in page.redirects),
        )
        for page in named.pages(run.root)
    }
