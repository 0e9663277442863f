"""Which folders a release has, and which files of them hold data.

A folder is one deposit: flat, whole in itself, with one licence. What belongs into it is listed by
name: shards of declared tables, the wiki's archives and their index, and what `kb release` makes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from kb.core.licences import KNOWN
from kb.core.profile import PROFILE_FILE
from kb.core.sources import PUBLISHED
from kb.schema import Table, released_tables
from kb.store.digests import SUMS
from kb.store.layout import Layout

TOMBSTONES = "tombstones.parquet"
DEPOSIT = "zenodo.json"
INDEX = "index.ndjson"
MADE = (
    "README.md",
    "DATASHEET.md",
    "CITATION.cff",
    "LICENSE",
    "croissant.json",
    DEPOSIT,
    TOMBSTONES,
    PROFILE_FILE,
    "keywords.tsv",
    "provenance.json",
    SUMS,
)
_ARCHIVE = re.compile(r"(screenshots|images)-\d{5}-of-\d{5}\.tar")


@dataclass(frozen=True, slots=True)
class Part:
    """One table of a folder and its shards, in order."""

    table: Table
    shards: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class Folder:
    """`release/<source>/`. `others` are data files that are no shards: the wiki's tar files and
    their index.

    `strays` is what no export and no release writes, and every link.
    """

    source: str
    path: Path
    parts: tuple[Part, ...]
    others: tuple[Path, ...]
    strays: tuple[Path, ...] = ()

    @property
    def data(self) -> list[Path]:
        """Every file that an export wrote."""
        return [shard for part in self.parts for shard in part.shards] + list(self.others)

    def files(self) -> list[Path]:
        """Every file of the folder but the checksums, by name; links are no files of it."""
        return [path for path in _files(self.path) if path.name != SUMS and not path.is_symlink()]

    def samples(self) -> list[tuple[Table, Path]]:
        """Samples with the tables that they are of: JSON files."""
        named = {sample_name(one): one for one in released_tables(self.source)}
        return [(named[path.name], path) for path in self.files() if path.name in named]


def find(root: Path) -> list[Folder]:
    """The folders under `release/` that an export has filled, in the contract's order."""
    folders = (read(Layout(root).release(source), source) for source in PUBLISHED)
    return [folder for folder in folders if folder.data]


def read(path: Path, source: str) -> Folder:
    """One folder as it is on disk; without data when it is not there."""
    files = _files(path)
    own = [file for file in files if not file.is_symlink()]
    parts = tuple(
        Part(declared, shards)
        for declared in released_tables(source)
        if (
            shards := tuple(
                file
                for file in own
                if re.fullmatch(rf"{declared.short}-\d{{5}}-of-\d{{5}}\.parquet", file.name)
            )
        )
    )
    tables = {shard for part in parts for shard in part.shards}
    others = tuple(
        file
        for file in own
        if source == "wiki" and (file.name == INDEX or _ARCHIVE.fullmatch(file.name))
    )
    known = {*tables, *others, *(file for file in own if is_made(file.name, source))}
    return Folder(source, path, parts, others, tuple(file for file in files if file not in known))


def is_made(name: str, source: str) -> bool:
    """Whether `kb release` writes a file of that name into the source's folder."""
    texts = {f"LICENSE-{spdx}.txt" for spdx in KNOWN}
    return (
        name in MADE
        or name in texts
        or name in {sample_name(declared) for declared in released_tables(source)}
    )


def _files(path: Path) -> list[Path]:
    """Files and links by name; hidden ones stay on this machine."""
    return [
        file
        for file in sorted(path.glob("*"))
        if not file.name.startswith(".") and (file.is_symlink() or file.is_file())
    ]


def sample_name(declared: Table) -> str:
    """The file with some rows of a table."""
    return f"{declared.short}.sample.json"
