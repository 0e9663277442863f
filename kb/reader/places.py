"""Which tables a folder holds: a data root, a `release/` folder, or one release folder.

Looks at names only; what is in the files is read when it is asked for. A shard that its
neighbours or SHA256SUMS speak of and that is not there is an error, never a smaller table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from kb.core.errors import DamagedData, UsageError
from kb.query.views import View, found, names
from kb.schema.tables import Table, table, tables
from kb.store import complete
from kb.store.layout import Layout

SUMS = "SHA256SUMS"
_SHARD = re.compile(r"([a-z][a-z0-9_]*)-([0-9]{5})-of-([0-9]{5})\.parquet")
_TOMBSTONES = "tombstones.parquet"
# Any of these makes a folder a data root (or what a reconstruction left), not one of releases.
_OF_A_ROOT = ("raw", "clean", "release", "state", "missing.parquet")
_AGAIN = "download it again, into the same folder"


class Placed(NamedTuple):
    """A view, and the folder that paths in its rows start from: a data root or a release folder."""

    view: View
    home: Path


def look(paths: Iterable[Path]) -> dict[str, Placed]:
    """The views of all these folders by full name ("release.youtube_videos").

    Raises UsageError for a folder without tables, and where two hold the same table; DamagedData
    for a missing shard.
    """
    every: dict[str, Placed] = {}
    for path in paths:
        for one in _of(path):
            other = every.setdefault(one.view.full, one)
            if other.view.files != one.view.files:
                raise UsageError(
                    f"{one.view.full} is in {other.home} and in {one.home}",
                    hint="load them apart: kb.load(…) for each",
                )
    return every


def _of(path: Path) -> list[Placed]:
    path = path.expanduser().absolute()
    if not path.exists():
        raise UsageError(f"there is no {path}", hint="check the path, and the folder you are in")
    if not path.is_dir():
        raise UsageError(
            f"{path} is a file", hint="give its folder: a release folder or a data root"
        )
    if single := list(_release(path)):
        return single
    several = [one for folder in sorted(path.glob("*/")) for one in _release(folder)]
    if several and not any((path / name).exists() for name in _OF_A_ROOT):
        return several
    views = list(found(path))
    for folder in sorted(Layout(path).release().glob("*/")):
        _check(folder)
    for folder in (*complete.tables(path), Layout(path).pairs):
        complete.check(folder)
    if views:
        return [
            Placed(one, one.files[0].parent if one.schema == "release" else path) for one in views
        ]
    demo = path / "demo"
    raise UsageError(
        f"{path} holds no tables: it is neither a release nor a data root",
        hint=f'the demo\'s are there: kb.load("{demo}")'
        if any(found(demo))
        else "give a folder with *-00000-of-0000N.parquet in it, one that holds such folders,"
        " or a data root",
    )


def _release(folder: Path) -> Iterator[Placed]:
    """The tables of one release folder, whatever its name; nothing where it is not one."""
    if not folder.is_dir():
        return
    shards: dict[str, list[Path]] = {}
    for path in _shards(folder):
        shards.setdefault(path.name.partition("-")[0], []).append(path)
    known = {short: paths for short, paths in shards.items() if short in _released()}
    if known or any(_SHARD.fullmatch(name) for name in _summed(folder)):
        _check(folder)
    if not known:
        return
    for short, paths in known.items():
        declared = _released()[short]
        yield Placed(View("release", names(declared), paths, declared.doc), folder)
    tombstones = folder / _TOMBSTONES
    if tombstones.is_file():
        source = _released()[next(iter(known))].source
        doc = table("shared/tombstones").doc
        yield Placed(View("release", f"{source}_tombstones", [tombstones], doc), folder)


@cache
def _released() -> dict[str, Table]:
    """Released tables by the first word of their shards' names."""
    return {one.short: one for one in tables().values() if one.released}


def _shards(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.parquet") if _SHARD.fullmatch(path.name))


def _check(folder: Path) -> None:
    """Raise DamagedData for a table's file that is not there."""
    there = {path.name for path in folder.glob("*.parquet")}
    wanted: dict[str, None] = {}
    for name in sorted(there):
        if shard := _SHARD.fullmatch(name):
            short, _, count = shard.groups()
            wanted |= {f"{short}-{at:05d}-of-{count}.parquet": None for at in range(int(count))}
    wanted |= {name: None for name in _summed(folder) if name.endswith(".parquet")}
    for name in wanted:
        if name not in there:
            raise DamagedData(f"{folder / name} is missing", hint=_AGAIN)


def _summed(folder: Path) -> Iterator[str]:
    """Names in SHA256SUMS, where there is one; names in other folders are left out."""
    sums = folder / SUMS
    if not sums.is_file():
        return
    for line in sums.read_text(encoding="utf-8", errors="replace").splitlines():
        name = line.partition("  ")[2].strip()
        if name and name == Path(name).name:
            yield name
