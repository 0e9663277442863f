"""Entities and links: what the profile's keywords name, and where the three sources speak of it.

The paper's three sources lie side by side; here each keyword leads to its wiki page, its videos
with the second, and its threads. Words are matched as for the pairs (pipelines/pairs.py).

    names      titles and redirects of the wiki's pages, from its raw answers
    tables     clean/ → links/*.parquet
    release    links/ → release/links/: ids and counts
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping

from kb.artifacts import belonging
from kb.artifacts.catalog import Catalog
from kb.core.context import Run
from kb.core.errors import FatalError, MissingExtra, ProfileError
from kb.core.verdict import Summary
from kb.export import layouts
from kb.links.build import build, check
from kb.links.entity_pages import Names
from kb.store.layout import Layout
from kb.wiki.parse import page_names


def links(run: Run) -> Summary:
    """Make the entity tables, then their release."""
    check(run)
    with belonging.writing(run, "links", "release-links"):
        made = tables(run)
        if Catalog(run.root.absolute()).is_download:
            return made
        layouts.export(run, "links")
    return Summary(made, release=str(Layout(run.root).release("links")))


def tables(run: Run) -> Summary:
    """Make the entity tables."""
    return build(run, lambda: names(run))


def again(run: Run) -> None:
    """Both again, as far as they are there; what can't be made again does not stay."""
    at = Layout(run.root)
    shutil.rmtree(at.linking, ignore_errors=True)
    if not at.links.exists():
        return
    try:
        tables(run)
    except (MissingExtra, ProfileError, FatalError) as error:
        shutil.rmtree(at.links)
        shutil.rmtree(at.release("links"), ignore_errors=True)
        run.progress.say(f"the entity tables were removed: {error}; `kb links` makes them again")
    else:
        layouts.export_again(run, "links")


def names(run: Run) -> Mapping[str, Names]:
    """What the wiki calls its pages, by title."""
    return {
        page.title: Names(
            page.title.removeprefix(f"{page.prefix}:"),
            tuple(title.removeprefix(f"{page.prefix}:") for title in page.redirects),
        )
        for page in page_names.pages(run.root)
    }
