"""A release folder: one deposit, flat, with shards of the tables of one source.

    videos-00000-of-00002.parquet    a shard of a released table
    screenshots-00000-of-00001.tar   the wiki's archives, with index.ndjson
    SHA256SUMS, profile.toml, …      what `kb release` adds

This is the one place that recognises such a folder and lists what is in it; `kb release`, `kb
restore`, `kb verify`, `kb query` and `kb.load` all ask here.
"""

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import cast

import orjson
import pyarrow as pa

from kb.artifacts import manifest
from kb.core.errors import DamagedData
from kb.core.installation import PROFILE_FILE
from kb.core.sources import PUBLISHED, selection_of
from kb.schema.tables import Table, released_tables, table
from kb.store.artifact_registry import SUMS
from kb.store.damage import DOWNLOAD, missing, opening, unreadable
from kb.store.state.tombstones import without_people
from kb.store.tables import parquet
from kb.store.tables.checksums import opened, read_small, read_sums
from kb.store.tables.parquet import released_table

TOMBSTONES = "tombstones.ndjson"  # readers of `*.parquet` took a Parquet file for a shard
INDEX = "index.ndjson"
OVERVIEW = "README.md"  # above the folders of a release: what they are
KEYWORDS = "keywords.tsv"  # that the profile names
_ARCHIVE = re.compile(r"(screenshots|images)-\d{5}-of-\d{5}\.tar")


@dataclass(frozen=True, slots=True)
class ReleasedTable:
    """One table of a folder and its shards, in order."""

    table: Table
    shards: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class ReleaseFolder:
    """The data files of a release folder.

    `source` is youtube, wiki, reddit, pairs or links; `others` are data files that are not shards:
    the wiki's tar files and their index, the list of a draw's videos.
    """

    source: str
    path: Path
    parts: tuple[ReleasedTable, ...]
    others: tuple[Path, ...]

    @property
    def name(self) -> str:
        """What it is called in a data root: its source, or the name of a selection."""
        return self.path.name if selection_of(self.path.name) == self.source else self.source

    @property
    def data(self) -> list[Path]:
        """Every file that an export wrote."""
        return [shard for part in self.parts for shard in part.shards] + list(self.others)

    def files(self) -> list[Path]:
        """Every file but the checksums, by name; hidden files are not part of it."""
        return [path for path in _own(self.path) if path.name != SUMS]

    @property
    def size(self) -> int:
        """Bytes of all files, also of those that links lead to."""
        files = (*self.files(), self.path / SUMS)
        return sum(file.stat().st_size for file in files if file.is_file())

    def shards(self, short: str) -> list[Path]:
        """The files of a released table."""
        return [shard for part in self.parts if part.table.short == short for shard in part.shards]

    @property
    def tombstones(self) -> Path | None:
        """The list of keys that were removed since collection began."""
        return next((path for path in _own(self.path) if path.name == TOMBSTONES), None)

    def removed(self) -> set[str]:
        """The removed keys. Raises DamagedData."""
        if self.tombstones is None:
            return set()
        return set(cast("list[str]", read_tombstones(self.tombstones)["key"].to_pylist()))

    @property
    def profile(self) -> Path | None:
        """The profile that the release was made with. Raises DamagedData where it, or a list that
        it may name, is no file or a link whose bytes SHA256SUMS does not describe.
        """
        mine = {path.name: path for path in entries(self.path)}
        for name, path in mine.items():
            if name == PROFILE_FILE or path.suffix == ".tsv":
                with opened(path):
                    pass
        return mine.get(PROFILE_FILE)

    def require_tables(self) -> None:
        """Raises DamagedData for a table's file that is not there, and for one that is a link which
        SHA256SUMS does not describe.
        """
        if lost := self._missing():
            raise missing(lost)
        mine = set(self.data)
        for path in entries(self.path):
            if released_table(path.name) is not None and path not in mine:
                raise unreadable(path, f"it is a link, and {SUMS} does not describe it")

    def _missing(self) -> list[Path]:
        """Table files that other shards or SHA256SUMS name and that are not there."""
        there = {path.name for path in self.path.glob("*.parquet") if path.exists()}
        named = manifest.siblings(there) | {
            name for name in sums(self.path)[0] if name.endswith(".parquet")
        }
        return [self.path / name for name in sorted(named - there)]


def recognise(folder: Path) -> ReleaseFolder | None:
    """The release folder that this is, by the names of its shards, or by those in SHA256SUMS where
    all are lost; None for any other folder.
    """
    names = [path.name for path in folder.glob("*.parquet")]
    for some in (names, sums(folder)[0]):
        if sources := sources_of(some):
            return read_release_folder(folder, sources.pop()) if len(sources) == 1 else None
    return None


def is_released(folder: Path) -> bool:
    """Whether a folder has checksums and is a release: nothing may be written into it."""
    return os.path.lexists(folder / SUMS) and recognise(folder) is not None


def sources_of(names: Iterable[str]) -> set[str]:
    """The sources whose tables' shards have these names."""
    return {declared.source for declared in map(released_table, names) if declared}


def read_release_folder(folder: Path, source: str) -> ReleaseFolder:
    """A source's folder as it is on disk; without data where it does not exist."""
    own = _own(folder)
    parts = tuple(
        ReleasedTable(declared, shards)
        for declared in released_tables(source)
        if (shards := tuple(file for file in own if table_of_shard(file.name) == declared.short))
    )
    others = tuple(
        file
        for file in own
        if file.name in PUBLISHED[source].lists
        or (PUBLISHED[source].archives and (file.name == INDEX or _ARCHIVE.fullmatch(file.name)))
    )
    return ReleaseFolder(source, folder, parts, others)


def read_tombstones(path: Path) -> pa.Table:
    """The tombstones of items in a file, as shared/tombstones declares them. Raises DamagedData."""
    if path.suffix == ".parquet":
        return without_people(parquet.read_table(path))
    return parse_tombstones(read_small(path), path)


def parse_tombstones(data: bytes, place: object) -> pa.Table:
    """The rows of tombstones.ndjson, which lies at `place`. Raises DamagedData."""
    schema = table("shared/tombstones").arrow(True)
    wrong = (ValueError, AttributeError, OverflowError, RecursionError, pa.ArrowException)
    rows = []
    for number, line in enumerate(data.splitlines(), start=1):
        where = f"{place}: line {number}"
        with opening(where, *wrong, hint=DOWNLOAD):
            row = orjson.loads(line)
            for name in schema.names:
                if not isinstance(row.get(name), str):
                    raise unreadable(where, f"column {name} is missing or no text", DOWNLOAD)
            row["removed_at"] = datetime.fromisoformat(row["removed_at"])
            rows.append(row)
    with opening(place, *wrong, hint=DOWNLOAD):
        return pa.Table.from_pylist(rows, schema)


def tombstone_lines(rows: pa.Table) -> str:
    """The rows as the file holds them: a JSON object a line."""
    lines = (orjson.dumps(row, option=orjson.OPT_UTC_Z) for row in rows.to_pylist())
    return "".join(f"{line.decode()}\n" for line in lines)


def releases_below(folder: Path) -> Iterator[ReleaseFolder]:
    """The release folders directly below a folder, by name."""
    for inner in sorted(folder.glob("*/")):
        if not inner.name.startswith(".") and (release := recognise(inner)):
            yield release


def entries(folder: Path) -> list[Path]:
    """What is not a folder, by name: files, links, and what can't be read, such as a pipe. Hidden
    ones stay on this machine.
    """
    return [
        file
        for file in sorted(folder.glob("*"))
        if not file.name.startswith(".") and (file.is_symlink() or not file.is_dir())
    ]


def _own(folder: Path) -> list[Path]:
    """The entries that are part of a release: of links, those that SHA256SUMS describes."""
    there = entries(folder)
    if not any(file.is_symlink() for file in there):
        return there
    described = sums(folder)[0]
    return [file for file in there if not file.is_symlink() or file.name in described]


def sums(folder: Path) -> tuple[dict[str, str], int]:
    """SHA256SUMS as (file name → digest, number of invalid lines); ({}, 0) where there is none.

    A file that can't be read as text counts as one invalid line.
    """
    path = folder / SUMS
    if not os.path.lexists(path):  # also where the folder can't be read
        return {}, 0
    try:
        return read_sums(path)
    except DamagedData:
        return {}, 1


def table_of_shard(name: str) -> str:
    """The table that a shard's name begins with, "" for another file."""
    declared = released_table(name)
    return declared.short if declared else ""
