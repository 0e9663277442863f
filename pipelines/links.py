"""Entities and links: the profile's keywords, and where the three sources mention them.

The paper has three separate sources; here each keyword links to its wiki page, to seconds in videos
and to threads. Keywords are matched as for pairs (pipelines/pairs.py).

    tables     clean/, and titles and redirects of the wiki's raw answers → links/*.parquet
    release    links/ → release/links/: ids and counts
"""

import shutil

from kb.artifacts import domain_binding
from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.links.build import build, check
from kb.store.layout import Layout
from kb.wiki.parse.answers import named_pages


def links(run: Run) -> Summary:
    """Make the entity tables, then their release."""
    check(run)
    with domain_binding.writing(run, "links", "release-links"):
        made = tables(run)
        if Catalog(run.root.absolute()).is_download:
            return made
        layouts.export(run, "links")
    return Summary(made, release=str(Layout(run.root).release("links")))


def tables(run: Run) -> Summary:
    """Make the entity tables."""
    return build(run, lambda: named_pages(run.root))


def rebuild(run: Run) -> None:
    """Rebuild existing entity tables and their release; delete what can't be rebuilt."""
    shutil.rmtree(Layout(run.root).linking, ignore_errors=True)
    layouts.rebuild(run, "links", "entity tables", tables)
