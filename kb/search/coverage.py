"""What a search of a folder covers, as one sentence wherever people or agents search."""

from pathlib import Path
from typing import NamedTuple

from kb.artifacts import texts
from kb.artifacts.table_catalog import Catalog
from kb.core.sources import SOURCES


class Coverage(NamedTuple):
    """What has texts here, and what was only released by its ids."""

    covered: list[str]
    lacking: list[str]

    def __str__(self) -> str:
        *others, last = self.covered or ["nothing"]
        sentence = f"Search covers {', '.join(others)}{' and ' * bool(others)}{last}"
        if not self.lacking:
            return f"{sentence}."
        without = ", ".join(f"no {what}" for what in self.lacking)
        return f"{sentence}; {without}: `kb restore` brings them back."


def coverage(root: Path) -> Coverage:
    """What a search of a data root or a download covers, and what it would after a restore.

    Sources that it has no rows of are left out. Raises DamagedData.
    """
    covered: list[str] = []
    lacking: list[str] = []
    catalog = Catalog(root.absolute())
    for name, source in SOURCES.items():
        if not source.indexed or not catalog.schema_of(name):
            continue
        there = texts.files(root, f"index/{name}", catalog)
        for short, what in (source.searched or {table: table for table in source.tables}).items():
            (covered if f"{name}/{short}" in there else lacking).append(what)
    return Coverage(covered, lacking)
