"""What the entity tables in links/ were made of, and whether the texts are still the same.

    links/_summary.json    keywords and files, by source, as fingerprints

`kb links` writes it; whoever reads the tables beside other ones (`kb search --entity`) asks here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from kb.artifacts import manifest
from kb.artifacts.catalog import Catalog
from kb.core.errors import UsageError
from kb.core.sources import SOURCES, SPECS
from kb.store import notes, parquet
from kb.store.advice import advice
from kb.store.layout import Layout


class Read(msgspec.Struct):
    """What was read of a source: fingerprints of its `files` by "<table>/<name>". `mark` stands for
    all that its rows follow from; `links` is how many they are.
    """

    mark: str
    files: dict[str, str]
    links: int


class LinksNote(msgspec.Struct):
    """What links/ holds and what it was made of."""

    entities: int
    with_page: int
    links: int
    mentions: int
    sources: dict[str, Read]


def path(root: Path) -> Path:
    """Where the note is: below the data root, or in the cache for a download."""
    return Layout(Catalog(root.absolute()).workplace).links / manifest.SUMMARY


def read(root: Path) -> LinksNote | None:
    """The note; None where there are no links. Raises DamagedData, also for lost files."""
    note: LinksNote | None = notes.read(path(root), LinksNote, mend=advice(path(root)))
    if note is None:
        return None
    manifest.check_folder(path(root).parent)
    return note


def older_than(root: Path) -> list[str]:
    """The sources whose clean files are others than those that were read; [] without links.

    Raises DamagedData.
    """
    note = read(root)
    if note is None:
        return []
    held, found = Catalog(root.absolute()), []
    for source in SOURCES:
        known = note.sources.get(source)
        if known is None:
            newer = bool(held.texts(f"{source}/{next(iter(SPECS[source].tables))}"))
        else:
            newer = known.files != prints(held, source, _tables(known.files))
        if newer:
            found.append(source)
    return found


def prints(held: Catalog, source: str, tables: Iterable[str]) -> dict[str, str]:
    """Fingerprints of the files that links are made of, by "<table>/<name>". Raises DamagedData."""
    return {
        f"{table}/{path.name}": parquet.content_digest(path)
        for table in tables
        for path in held.texts(f"{source}/{table}")
    }


def _tables(files: Iterable[str]) -> list[str]:
    return sorted({name.partition("/")[0] for name in files})


def check(root: Path, now: Mapping[str, Mapping[str, str]]) -> None:
    """Raises UsageError where there are no links, or they were made of other files than `now`:
    those of each source, by "<table>/<name>", with their fingerprints. Other tables don't count,
    and a release's tables are taken as they are.
    """
    note = read(root)
    if note is None and Catalog(root.absolute()).files("links/entities"):
        return
    if note is None:
        raise UsageError(f"there are no entity tables in {root}", hint="run `kb links` first")
    for source, files in now.items():
        known = note.sources.get(source)
        held = known.files if known is not None else {}
        tables = _tables(held)
        if held != {name: sha for name, sha in files.items() if name.partition("/")[0] in tables}:
            raise UsageError(
                f"the entity tables in {path(root).parent} are older than the texts of {source}",
                hint="run `kb links`",
            )
