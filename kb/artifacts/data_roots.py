"""Tells data roots from downloads, into which nothing is written.

A release folder is recognised by its checksums, whatever else lies in it; so `state/` that was left
in a download does not make it a data root. Folders that can't be read are none of these.
"""

import contextlib
import os
from pathlib import Path

import msgspec

from kb.artifacts.release_folder import is_released
from kb.core.errors import DamagedData, NewerVersion
from kb.store.damage import read_note
from kb.store.layout import Layout

# Of data roots. It rises when older versions would misread what is written (docs/upgrading.md).
FORMAT = 1

_OF_A_ROOT = ("raw", "state", "clean", "restored")  # any of these makes a folder a data root
_MOST = 500  # entries of a folder among which others are looked for
_SEVERAL = 2  # releases that make the folder above them a download


def is_root(path: Path) -> bool:
    """Whether a folder is a data root, which commands may write to. A release is none, nor is a
    folder above several, although `state/` was left in it.
    """
    made = [name for name in _OF_A_ROOT if _is_folder(path / name)]
    below = Layout(path).restored()
    if made == [below.name] and _is_folder(Layout(below).restored()):
        return False  # a data root of that name beside releases, as their cards propose
    if not made or is_released(path):
        return False
    return made != ["state"] or not any(map(is_released, folders_in(path)))


class _Noted(msgspec.Struct):
    """What of state/profile.json says which versions can read a data root."""

    format: int = FORMAT


def require_known_format(root: Path) -> None:
    """Raises NewerVersion for a data root that a newer version wrote in another form."""
    noted = None
    with contextlib.suppress(DamagedData):  # whoever needs the profile raises it
        noted = read_note(Layout(root).profile, _Noted)
    if noted is not None and noted.format > FORMAT:
        raise NewerVersion(
            f"a newer Lorecrawl wrote the data root {root} (format {noted.format}; this version"
            f" knows {FORMAT})",
            hint="upgrade Lorecrawl",
        )


def download_around(place: Path, *, named: bool = True) -> Path | None:
    """The release folder that a place, which need not exist, lies in. For one that nobody named
    also a folder that holds several releases and no other folders.
    """
    parents = Path(os.path.realpath(place)).parents
    around = next(filter(is_released, parents), None)
    if around is None and not named:
        inner = folders_in(parents[0])
        return parents[0] if len(inner) >= _SEVERAL and all(map(is_released, inner)) else None
    return around


def folders_in(path: Path) -> list[Path]:
    """The folders in a folder, those of `kb demo` first; none where it can't be listed."""
    try:
        with os.scandir(path) as entries:
            some = [Path(entry) for entry, _ in zip(entries, range(_MOST), strict=False)]
    except OSError:
        return []
    folders = [folder for folder in some if folder.name[0] != "." and _is_folder(folder)]
    return sorted(folders, key=lambda folder: (folder.name != "demo", folder.name))


def _is_folder(path: Path) -> bool:
    return os.path.isdir(path)  # noqa: PTH112  Path's raises where it may not look
