"""Which files a table should have, so that a lost one is never taken for fewer rows.

clean/<source>/files.json          the files of each table and verdict, as the filter wrote them
<table>-00000-of-0000N.parquet     the name says how many there are
state/release-<source>.exported    an export has filled release/<source>: the digest of
                                   what it was made of (kb.artifacts.inputs)
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

from kb.core.errors import DamagedData
from kb.store.advice import advice
from kb.store.atomic import write_text
from kb.store.layout import Layout, parquet_files

LIST = "files.json"
# What is made of all sources has a note beside it, and always a file of each of its tables.
NOTE = "_summary.json"  # the underscore hides it from readers of a folder of Parquet
_TABLES = {"pairs": ("pairs",), "links": ("entities", "links")}
_SHARD = re.compile(r"(.+)-(\d{5})-of-(\d{5})(\.[a-z]+)")


def rows(root: Path, name: str) -> list[Path]:
    """The files of a declared table's rows ("youtube/videos"), in order.

    None where nothing was made yet. Raises DamagedData where one of them is not there.
    """
    check(Layout(root).table(name))
    return Layout(root).rows(name)


def files(root: Path, source: str, tables: Iterable[str]) -> dict[str, Path]:
    """Files of a source's clean tables by "<table>/<name>". Raises DamagedData for a lost one."""
    return {
        f"{table}/{path.name}": path for table in tables for path in rows(root, f"{source}/{table}")
    }


def check(folder: Path) -> None:
    """Raises DamagedData for the first file of a table's folder that is not there."""
    gone = missing(folder)
    if gone:
        more = f" (and {len(gone) - 1:,} more files)" if len(gone) > 1 else ""
        raise DamagedData(f"{gone[0]} is missing{more}", hint=advice(gone[0]))


def tables(root: Path) -> list[Path]:
    """The folders of all tables that filters wrote, those of lost ones too. Raises DamagedData."""
    cleans = sorted(place.parent for place in Layout(root).clean().glob(f"*/{LIST}"))
    return [clean / table for clean in cleans for table in listed(clean)]


def missing(folder: Path) -> list[Path]:
    """Files of a table's folder that were written and are not there, by name."""
    written = [folder / name for name in listed(folder.parent).get(folder.name, ())]
    there = {path.name for path in parquet_files(folder)}
    if (folder / NOTE).is_file():
        for name in _TABLES.get(folder.name, ()):
            if not any(file.startswith(f"{name}-") for file in there):
                written.append(folder / f"{name}-00000-of-00001.parquet")
    numbered = [folder / name for name in siblings(there)]
    return sorted({path for path in (*written, *numbered) if path.name not in there})


def siblings(names: Iterable[str]) -> set[str]:
    """The names of all shards that these shards speak of; others are left out."""
    every = set()
    for name in names:
        if match := _SHARD.fullmatch(name):
            stem, _, count, ending = match.groups()
            every |= {f"{stem}-{number:05d}-of-{count}{ending}" for number in range(int(count))}
    return every


def write_list(clean: Path) -> None:
    """Note the files of a source's clean folder, which is on its way."""
    tables = sorted(path for path in clean.iterdir() if path.is_dir())
    files = {path.name: [file.name for file in parquet_files(path)] for path in tables}
    write_text(clean / LIST, json.dumps(files, indent=1) + "\n")


def note_export(root: Path, source: str, inputs: str = "") -> None:
    """Remember that release/<source> is to be there, and the digest of what it was made of."""
    if exported_from(root, source) != inputs:
        write_text(_exported(root, source), inputs)


def exported_from(root: Path, source: str) -> str | None:
    """The digest that the last export noted, "" for one that noted none; None before the first."""
    place = _exported(root, source)
    return place.read_text(encoding="utf-8", errors="replace") if place.is_file() else None


def exported(root: Path, source: str) -> bool:
    """Whether an export has filled release/<source>."""
    return _exported(root, source).exists()


def _exported(root: Path, source: str) -> Path:
    return Layout(root).state_folder() / f"release-{source}.exported"


def listed(clean: Path) -> dict[str, list[str]]:
    """What `write_list` noted, {} where nothing did. Raises DamagedData."""
    place = clean / LIST
    if not place.is_file():
        return {}
    try:
        found: dict[str, list[str]] = json.loads(place.read_text(encoding="utf-8"))
        return {table: [str(name) for name in names] for table, names in found.items()}
    except (ValueError, AttributeError, TypeError):
        raise DamagedData(f"{place} can't be read", hint=advice(place)) from None
