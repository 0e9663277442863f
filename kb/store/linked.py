"""What the entity tables in links/ were made of, and whether clean/ still says the same.

    links/_summary.json    keywords and clean files, by source, as digests

`kb links` writes it; whoever reads the tables beside other ones (`kb search --entity`) asks here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from kb.core.errors import UsageError
from kb.core.sources import SORTED, SOURCES
from kb.store import complete, notes
from kb.store.advice import advice
from kb.store.digests import digest
from kb.store.layout import Layout


class Read(msgspec.Struct):
    """What was read of a source: `files` with their SHA-256, by "<table>/<name>". `mark` stands for
    all that its rows follow from; `links` is how many they are.
    """

    mark: str
    files: dict[str, str]
    links: int


class Note(msgspec.Struct):
    """What links/ holds and what it was made of."""

    entities: int
    with_page: int
    links: int
    mentions: int
    sources: dict[str, Read]


def path(root: Path) -> Path:
    """Where the note is."""
    return Layout(root).links / complete.NOTE


def read(root: Path) -> Note | None:
    """The note; None where there are no links. Raises DamagedData, also for lost files."""
    note: Note | None = notes.read(path(root), Note, mend=advice(path(root)))
    if note is None:
        return None
    complete.check(Layout(root).links)
    return note


def older_than(root: Path) -> list[str]:
    """The sources whose clean files are others than those that were read; [] without links.

    Reads all of these files. Raises DamagedData.
    """
    note = read(root)
    if note is None:
        return []
    found = []
    for source in SOURCES:
        known = note.sources.get(source)
        if known is None:
            newer = bool(complete.rows(root, f"{source}/{next(iter(SORTED[source]))}"))
        else:
            newer = known.files != _digests(root, source, _tables(known.files))
        if newer:
            found.append(source)
    return found


def _digests(root: Path, source: str, tables: Iterable[str]) -> dict[str, str]:
    return {name: digest(path) for name, path in complete.files(root, source, tables).items()}


def _tables(files: Iterable[str]) -> list[str]:
    return sorted({name.partition("/")[0] for name in files})


def check(root: Path, now: Mapping[str, Mapping[str, str]]) -> None:
    """Raises UsageError where there are no links, or they were made of other files than `now`:
    those of each source, by "<table>/<name>", with their SHA-256. Other tables don't count.
    """
    note = read(root)
    if note is None:
        raise UsageError(
            f"there are no entity tables in {Layout(root).links}", hint="run `kb links` first"
        )
    for source, files in now.items():
        known = note.sources.get(source)
        held = known.files if known is not None else {}
        tables = _tables(held)
        if held != {name: sha for name, sha in files.items() if name.partition("/")[0] in tables}:
            raise UsageError(
                f"the entity tables in {Layout(root).links} are older than clean/{source}",
                hint="run `kb links`",
            )
