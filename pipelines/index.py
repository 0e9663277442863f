"""Index: passages of a source's texts, as `kb search` reads them.

A passage is a transcript's window, a section or table of the wiki, a post or a comment.
"""

from kb.core.context import Run
from kb.core.summary import Summary
from kb.registry import SOURCES
from kb.search.build import follow


def index(run: Run, source: str) -> Summary:
    """Texts of one source → index/<source>; none where it has no texts."""
    return follow(run, source, SOURCES[source].passages)
