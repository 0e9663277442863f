"""Which folders a release has, and which files of them hold data.

A folder is one deposit: flat, whole in itself, with one licence.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from kb.core.profile.release import SOURCES
from kb.schema import Table, tables

SUMS = "SHA256SUMS"
TOMBSTONES = "tombstones.parquet"
DEPOSIT = "zenodo.json"
MADE = ("README.md", "DATASHEET.md", "CITATION.cff", "LICENSE", "croissant.json", DEPOSIT, TOMBSTONES, SUMS)


@dataclass(frozen=True, slots=True)
class Part:
    """One table of a folder and its shards, in order."""

    table: Table
    shards: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class Folder:
    """`release/<source>/`. `others` are data files that are no shards (the wiki's tar files)."""

    source: str
    path: Path
    parts: tuple[Part, ...]
    others: tuple[Path, ...]

    @property
    def data(self) -> list[Path]:
        """Every file that an export wrote."""
        return [shard for part in self.parts for shard in part.shards] + list(self.others)

    def files(self) -> list[Path]:
        """Every file of the folder but the checksums, by name."""
        return sorted(path for path in self.path.iterdir() if path.is_file() and path.name != SUMS and not path.name.startswith("."))


def released_tables(source: str) -> list[Table]:
    """The declared tables that a source's folder holds."""
    return [declared for declared in tables().values() if declared.source == source and declared.released]


def find(root: Path) -> list[Folder]:
    """The folders under `release/` that an export has filled, in the contract's order."""
    return [folder for source in SOURCES if (folder := read(root / "release" / source, source)).data]


def read(path: Path, source: str) -> Folder:
    """One folder as it is on disk; without data when it is not there."""
    parts = tuple(
        Part(declared, shards)
        for declared in released_tables(source)
        if (shards := tuple(sorted(path.glob(f"{declared.short}-[0-9]*-of-[0-9]*.parquet"))))
    )
    shards = {shard for part in parts for shard in part.shards}
    made = set(MADE)
    others = tuple(file for file in sorted(path.glob("*")) if file.is_file() and file not in shards and not is_made(file.name, made))
    return Folder(source, path, parts, others)


def is_made(name: str, made: set[str] | frozenset[str] = frozenset(MADE)) -> bool:
    """Whether `kb release` writes a file of that name."""
    return name in made or name.startswith((".", "sample-")) or (name.startswith("LICENSE-") and name.endswith(".txt"))


def clean_files(root: Path, declared: Table) -> list[Path]:
    """The clean files that a released table was exported from."""
    folder = root / "pairs" if declared.source == "pairs" else root / "clean" / declared.source / declared.short
    return sorted(folder.glob("*.parquet"))
