"""What killed commands left behind: temporary files, new and old folders, leases.

Each holds what may have been purged since, so whoever gets a lock (kb.store.lock) first clears
what lies where the lock allows to write; a folder that was on its way to be replaced comes back.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from kb.store.atomic import settle_folder

_FILE = re.compile(r"\..+\.(tmp|filled\.parquet)|\.filled\.parquet")
_FOLDER = re.compile(r"\.(?P<name>.+)\.(new|old)|\.(sort|shot)-.+")
_PLACES = {
    "pairs": ("pairs", "state/pairs"),
    "report": ("report",),
    "deposits": (),
    "release-youtube": (
        "release/youtube",
        "export/minedojo/youtube_full.json",
        "export/minedojo/youtube_tutorial.json",
    ),
    "release-wiki": ("release/wiki", "export/minedojo/wiki_full"),
    "release-reddit": (
        "release/reddit",
        "export/minedojo/reddit.json",
        "export/convokit",
    ),
    "release-pairs": (
        "release/pairs",
        "export/minedojo/pairs.json",
        "export/clip4mc",
        "export/video2dataset",
    ),
}


def sweep(root: Path, name: str) -> None:
    """Clear what is left where the lock `name` allows to write. Call it under that lock."""
    for place in _PLACES.get(name, _of_source(name)):
        path = root / place
        _beside(path)
        if path.is_dir() and not path.is_symlink():
            _below(path)


def _of_source(source: str) -> tuple[str, ...]:
    folders = ("raw", "annotations", "clean", "state")
    return (*(f"{folder}/{source}" for folder in folders), f"state/{source}-import")


def _beside(path: Path) -> None:
    """Hidden files and folders that bear the name of `path`: `.NAME.new`, `.NAME.work`, `.NAME….tmp`."""
    if path.parent.is_dir():
        for entry in sorted(path.parent.iterdir()):
            if entry.name.startswith(f".{path.name}."):
                _clear(entry)


def _below(folder: Path) -> None:
    for where, folders, files in os.walk(folder):
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
