"""Entities and links: the profile's keywords, and where the three sources mention them.

The paper has three separate sources; here each keyword links to its wiki page, to seconds in videos
and to threads. Keywords are matched as for pairs (pipelines/pairs.py).

    tables     clean/, and titles and redirects of the wiki's raw answers → links/*.parquet
    export     links/ → release/links/: ids and counts
"""

from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.links.build import build
from kb.registry import PUBLISHED, SOURCES
from kb.wiki.parse.answers import named_pages


def tables(run: Run) -> Summary:
    """Make the entity tables."""
    return build(run, SOURCES, lambda: named_pages(run.root))


def export(run: Run) -> Summary:
    """links/ to release/links."""
    return layouts.export(run, PUBLISHED["links"])
