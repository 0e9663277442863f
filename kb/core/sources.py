"""The sources and what is published, by the names of their folders. A new source is named here."""

# What a filter sorts of each source: tables, and what their keys begin with in rejected, failed
# and pending.
SORTED: dict[str, dict[str, str]] = {
    "youtube": {"videos": ""},
    "wiki": {"pages": ""},
    "reddit": {"posts": "t3_", "comments": "t1_"},
}
SOURCES = tuple(SORTED)
PUBLISHED = (*SOURCES, "pairs", "links")

# What is made of other sources' rows, and of which.
MADE_OF = {"pairs": ("youtube",), "links": SOURCES}


def made_of(source: str) -> tuple[str, ...]:
    """The sources whose rows are behind what is published under that name."""
    return MADE_OF.get(source, (source,))


def made_by(source: str) -> str:
    """The command that makes the tables of what is published."""
    return f"kb {source} filter" if source in SOURCES else f"kb {source}"


def exported_by(source: str) -> str:
    """The command that makes its release folder."""
    return f"kb {source} export" if source in SOURCES else f"kb {source}"
