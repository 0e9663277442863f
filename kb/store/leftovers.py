"""Removes leftovers of killed commands: temporary files, new and old folders, leases.

Each holds what may have been purged since, so whoever gets a lock (kb.store.lock) first clears
what lies where the lock allows to write, and what no process can be using any more of what DuckDB
spilled; a folder that was on its way to be replaced comes back.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from kb.core.sources import EXPORTS, MADE_OF, SPECS, made_of
from kb.store import process
from kb.store.atomic import followed, settle_folder
from kb.store.layout import Layout
from kb.store.tables import database

_FILE = re.compile(r"\..+\.(tmp|filled\.parquet)|\.filled\.parquet")
_FOLDER = re.compile(r"\.(?P<name>.+)\.(new|old)|\.(sort|shot)-.+")


def is_left(parts: Iterable[str]) -> bool:
    """Whether a path has a name in it that only what is on its way, or was left, has."""
    return any(
        _FILE.fullmatch(name)
        or _FOLDER.fullmatch(name)
        or name.endswith(".lease")
        or name.startswith(f"{database.SPILL}-")
        or (name.startswith(".") and name.endswith(".work"))
        for name in parts
    )


def sweep(root: Path, name: str) -> None:
    """Clear what is left where the lock `name` allows to write. Call it under that lock."""
    _spilled(root)
    remove_temporary(Layout(root).profile)
    for folder in _folders_read(Layout(root), name):
        settle_folder(folder)
    # The manifest of a public folder is kept in state/ (kb.artifacts.manifest).
    manifest = Layout(root).state_folder("manifests") / f"{name}.json"
    for path in (manifest, *_places(Layout(root), name)):
        for place in dict.fromkeys((path, followed(path))):
            _remove_temporary(place)
            if place.is_dir() and not place.is_symlink():
                _remove_temporary_below(place)


def _places(at: Layout, name: str) -> tuple[Path, ...]:
    """Where the lock `name` allows to write; it is a source's where it is none of these."""
    match name:
        case "pairs":
            return at.pairs, at.pairing
        case "links":
            return at.links, at.linking
        case "report":
            return (at.report,)
        case "deposits":
            return (at.deposits,)
        case "restored":
            return (at.restored(),)
        case "reconstructed":
            return (at.reconstructed,)
    kind, _, of = name.partition("-")
    if kind == "index":
        return (at.index(of),)
    if kind == "release":
        exports = SPECS[of].exports if of in SPECS else EXPORTS.get(of, ())
        return at.release(of), at.released(of), *(at.export(*one.split("/")) for one in exports)
    folders = at.raw(name), at.annotations(name), at.clean(name), at.state_folder(name)
    return *folders, at.importing(name)


def _folders_read(at: Layout, name: str) -> tuple[Path, ...]:
    """Folders that nobody replaces while the lock `name` is held (kb.store.lock.of_clean).

    Whoever holds it reads them: one whose replacement was cut off is put back first.
    """
    if name in MADE_OF:
        return tuple(at.clean(one) for one in made_of(name))
    kind, _, source = name.partition("-")
    return (at.clean(source),) if kind in ("release", "index") and source in SPECS else ()


def _remove_temporary(path: Path) -> None:
    """Hidden files and folders that bear the name of `path`: `.NAME.new`,
    `.NAME.work`, `.NAME….tmp`.
    """
    if path.parent.is_dir():
        for entry in sorted(path.parent.iterdir()):
            if entry.name.startswith(f".{path.name}."):
                _clear(entry)


def _spilled(folder: Path) -> None:
    """What killed queries spilled into `folder`: readers take no lock, so it is no lock's own."""
    for entry in sorted(folder.glob(f"{database.SPILL}-*")):
        if database.abandoned(entry):
            _clear(entry)


def remove_temporary(path: Path) -> None:
    """What processes that ended left of a file which no lock is for."""
    for entry in sorted(path.parent.glob(f".{path.name}.*.tmp")):
        if process.has_ended(entry.name.removeprefix(f".{path.name}.")):
            _clear(entry)


def _remove_temporary_below(folder: Path) -> None:
    for where, folders, files in os.walk(folder):
        _spilled(Path(where))
        for name in files:
            if _FILE.fullmatch(name) or name.endswith(".lease"):
                Path(where, name).unlink(missing_ok=True)
        for name in sorted(folders):
            if _FOLDER.fullmatch(name):
                _clear(Path(where, name))
        folders[:] = [name for name in folders if Path(where, name).is_dir()]


def _clear(entry: Path) -> None:
    match = _FOLDER.fullmatch(entry.name)
    if match is not None and match["name"]:
        settle_folder(entry.with_name(match["name"]))
    elif entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry, ignore_errors=True)
    else:
        entry.unlink(missing_ok=True)
