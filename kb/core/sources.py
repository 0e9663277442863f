"""The sources and what is published, by the names of their folders. A new source is named here."""

SOURCES = ("youtube", "wiki", "reddit")
PUBLISHED = (*SOURCES, "pairs")
