"""What waits and what is done in a frontier, by source: one noun for each of its kinds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

# By source and kind of the frontier, in the order of work.
NOUNS: dict[str, dict[str, str]] = {
    "youtube": {
        "searches": "searches",  # pages of channel searches
        "uploads": "channels",  # channels whose uploads are listed
        "videos": "videos",  # videos whose metadata is read
        "transcripts": "transcripts",  # videos whose transcript is asked for
        "statistics": "statistics to refresh",  # videos whose counts are read again
        "refresh": "videos to refresh",  # videos that are read again in full
    },
    "wiki": {
        "site": "site descriptions",  # what the wiki says of itself, once a round
        "titles": "title lists",  # lists of titles, one a namespace and round
        "info": "titles",  # titles whose revision is asked for, a round each
        "gone": "comparisons",  # rounds that are compared with the pages known before
        "pages": "pages",  # pages that the browser shows
        "files": "image files",  # original files of images
    },
    "reddit": {
        "listing": "listings",  # listings of posts
        "tree": "posts",  # posts that are read with their comments
        "more": "further comments",  # comments that a post's page only names
        "thread": "deep threads",  # threads that go on on a page of their own
        "info": "posts and comments to refresh",  # those that are read again
    },
}
NOTED = {"youtube": ("channels",)}  # kinds that are only noted: nothing of them is asked
COUNTED = {"youtube": "videos", "wiki": "pages", "reddit": "posts"}  # what a crawl counts


def noun(source: str, kind: str) -> str:
    """What an item of the frontier is called."""
    return NOUNS.get(source, {}).get(kind, kind.replace("_", " "))


def counted(source: str) -> str:
    """What a crawl of the source counts."""
    return COUNTED.get(source, "items")


def in_order(source: str, kinds: Iterable[str]) -> list[str]:
    """Kinds of the frontier in the order of work, without those that are only noted."""
    known = [kind for kind in kinds if kind not in NOTED.get(source, ())]
    order = list(NOUNS.get(source, {}))
    return sorted(known, key=lambda kind: order.index(kind) if kind in order else len(order))


def to_read(kinds: Mapping[str, Mapping[str, int]], kind: str) -> int:
    """How many items a next crawl would ask for: those that wait, and those that failed."""
    counts = kinds.get(kind, {})
    return sum(counts.get(status, 0) for status in ("todo", "in_progress", "error"))


def left_by(source: str, kinds: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
    """What waits, by noun in the order of work, from counts by kind; nought is left out."""
    waiting = {
        noun(source, kind): kinds[kind].get("todo", 0) + kinds[kind].get("in_progress", 0)
        for kind in in_order(source, kinds)
    }
    return {name: n for name, n in waiting.items() if n}
