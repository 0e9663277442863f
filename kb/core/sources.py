"""The sources and what is published, by the names of their folders.

A new source is a package, its schemas and its name in `CLASSES`.
"""

from kb.core.publication import Links, OpenText, Pairs, Publication, Tasks
from kb.core.source import Source
from kb.reddit.source import Reddit
from kb.wiki.source import Wiki
from kb.youtube.source import YouTube

CLASSES: tuple[type[Source], ...] = (YouTube, Wiki, Reddit)

SOURCES = {each.name: each() for each in CLASSES}
MADE: tuple[Publication, ...] = (Pairs(), Tasks(), Links(), OpenText())
PUBLISHED: dict[str, Publication] = {**SOURCES, **{each.name: each for each in MADE}}

# What is made from the rows of other sources, and of which.
MADE_OF = {
    "pairs": ("youtube",),
    "tasks": ("youtube",),
    "links": tuple(SOURCES),
    "open-text": ("youtube",),
}

# What every release holds; the rest is there where the profile asks for it.
BY_DEFAULT = tuple(name for name in PUBLISHED if not PUBLISHED[name].part_of)


def made_of(name: str) -> tuple[str, ...]:
    """The sources whose rows are behind what is published under that name."""
    return MADE_OF.get(name, (name,))
