"""Removes leftovers of killed commands: temporary files, new and old folders, leases.

Leftovers may hold content that was purged since. Acquiring a lock (kb.store.lock) therefore first
clears them from the folders that the lock protects, and removes what queries of ended processes
spilled. A folder whose replacement was interrupted comes back.
"""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from kb.store import atomic
from kb.store.artifact_registry import ARTIFACTS
from kb.store.atomic import followed, settle_folder
from kb.store.layout import Layout
from kb.store.walk import walk

SPILL = ".duckdb"  # and the process: what DuckDB spilled (kb.store.tables.database)
PART = ".part"  # of a segment or download that is not complete: `.NAME.part`
_FILE = re.compile(r"\..+\.(tmp|filled\.parquet)|\.filled\.parquet")
_FOLDER = re.compile(r"\.(?P<name>.+)\.(new|old)|\..+\.gone|\.(sort|shot)-.+")


def is_left(parts: Iterable[str]) -> bool:
    """Whether a path has a name in it that only what is on its way, or was left, has."""
    return any(
        _FILE.fullmatch(name)
        or _FOLDER.fullmatch(name)
        or name.endswith(".lease")
        or name.startswith(f"{SPILL}-")
        or (name.startswith(".") and name.endswith((".work", PART)))
        for name in parts
    )


def sweep(root: Path, name: str) -> None:
    """Remove what killed commands left in the folders that the lock `name` protects.

    Call it under that lock. A folder whose replacement was interrupted comes back, also one that
    the lock's commands read: nobody replaces it while they hold the lock (kb.store.lock.of_clean).
    """
    at = Layout(root)
    artifacts = [artifact for artifact in ARTIFACTS.values() if artifact.lock == name]
    _spilled(root)
    remove_temporary(at.profile)
    remove_temporary_in(at.kept_profile)
    for read in {made_of for artifact in artifacts for made_of in artifact.inputs}:
        if read.startswith("clean/") and name != "report":  # a report does not lock what it reads
            settle_folder(root / read)
    folders = [artifact.folder(root) for artifact in artifacts]
    folders += [artifact.manifest(root) for artifact in artifacts if artifact.public]
    if (released := name.removeprefix("release-")) != name:
        folders.append(at.released(released))
    elif name == "deposits":
        folders.append(at.deposits)
    else:  # of a source, pairs or links; elsewhere there are none
        folders += [at.raw(name), at.state_folder(name), at.importing(name)]
    for path in folders:
        for place in dict.fromkeys((path, followed(path))):
            _remove_temporary(place)
        _remove_temporary_below(path, root)


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
    for entry in sorted(folder.glob(f"{SPILL}-*")):
        if atomic.has_ended(entry.name):
            _clear(entry)


def remove_temporary(path: Path) -> None:
    """What processes that ended left of a file which no lock is for."""
    for entry in sorted(path.parent.glob(f".{path.name}.*.tmp")):
        if atomic.has_ended(entry.name.removeprefix(f".{path.name}.")):
            _clear(entry)


def remove_temporary_in(folder: Path) -> None:
    """What processes that ended left in a folder of the user's, at any depth."""
    for entry in folder.rglob(".*.tmp"):
        if atomic.has_ended(entry.name):
            _clear(entry)


def _remove_temporary_below(folder: Path, root: Path) -> None:
    # Raw data that can't be reached are no empty folder; all else is made of what can.
    strict = folder.is_relative_to(Layout(root).raw())
    for where, folders, others in walk(folder, root, strict=strict):
        _spilled(where)
        for name in (entry.name for entry in others):
            published = name.endswith(PART) and (where / name[1 : -len(PART)]).exists()
            if published or _FILE.fullmatch(name) or name.endswith(".lease"):
                (where / name).unlink(missing_ok=True)
        for name in folders:
            if _FOLDER.fullmatch(name):
                _clear(where / name)
        folders[:] = [name for name in folders if (where / name).is_dir()]


def _clear(entry: Path) -> None:
    match = _FOLDER.fullmatch(entry.name)
    if match is not None and match["name"]:
        settle_folder(entry.with_name(match["name"]))
    elif entry.is_dir() and not entry.is_symlink():
        shutil.rmtree(entry, ignore_errors=True)
    else:
        entry.unlink(missing_ok=True)
