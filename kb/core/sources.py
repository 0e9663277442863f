"""The sources and what is published, by the names of their folders. A new source is named here."""

# What a filter sorts of each source: tables, and what their keys begin with in rejected, failed
# and pending.
SORTED: dict[str, dict[str, str]] = {
    "youtube": {"videos": ""},
    "wiki": {"pages": ""},
    "reddit": {"posts": "t3_", "comments": "t1_"},
}
SOURCES = tuple(SORTED)
PUBLISHED = (*SOURCES, "pairs")
