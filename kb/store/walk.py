"""Walks the folders of a data root, or others that a user names, through links to folders.

A full disk's usual remedy is to move a folder to another disk and to put a link in its place. So a
link to a folder counts as that folder, at every depth. Two kinds of links do not: one that leads
back into the data root, whose files would be there twice or without end, and one that leads
nowhere, as a disk that is not mounted is no empty folder. This is for the user's own folders; of a
download no link is followed.
"""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import DamagedData

_LOST_AND_FOUND = "lost+found"  # at the top of a disk; only its owner may look into it


def walk(
    folder: Path, root: Path | None = None, *, strict: bool = True
) -> Iterator[tuple[Path, list[str], list[os.DirEntry[str]]]]:
    """Each folder from `folder` on, top down: its path, the names of its folders, which the caller
    may remove to pass them over, and its other entries, both sorted. Nothing where there is no
    folder.

    `root` is the data root, where `folder` lies below it. Raises DamagedData for a link that leads
    back or nowhere, PermissionError for a folder that can't be read; without `strict` such links
    are among the other entries, and nothing is in such folders.
    """
    top = folder if root is None else root
    walked = [top.resolve()]  # what is walked
    for place in reversed([folder, *folder.parents]):
        if place != top and place.is_relative_to(top) and place.is_symlink():
            if refusal := _refusal(place, walked):
                if strict:
                    raise refusal
                return
            walked.append(place.resolve())
    waiting = [folder]
    while waiting:
        where = waiting.pop()
        folders, others = [], []
        for entry in _entries(where, strict):
            if entry.is_symlink() and (refusal := _refusal(Path(entry.path), walked)):
                if strict and not entry.name.startswith("."):  # editors make some that lead nowhere
                    raise refusal
                others.append(entry)
            elif not entry.is_dir():
                others.append(entry)
            elif entry.name != _LOST_AND_FOUND:
                folders.append(entry.name)
                if entry.is_symlink():
                    walked.append(Path(entry.path).resolve())
        yield where, folders, others
        waiting += [where / name for name in reversed(folders)]


def files_below(folder: Path, root: Path | None = None, *, strict: bool = True) -> Iterator[Path]:
    """Every file below a folder, and links to files; hidden ones too. As `walk`."""
    for _, _, others in walk(folder, root, strict=strict):
        for path, entry in ((Path(entry.path), entry) for entry in others):
            if entry.is_file(follow_symlinks=False) or path.is_file():
                yield path


def _entries(where: Path, strict: bool) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(where) as entries:
            return sorted(entries, key=lambda entry: entry.name)
    except (FileNotFoundError, NotADirectoryError):
        return []  # removed meanwhile
    except PermissionError:
        if strict and not where.name.startswith("."):  # which systems keep on a disk
            raise
        return []


def _refusal(link: Path, walked: list[Path]) -> DamagedData | None:
    """Why a link is not followed; None for one to a file or to another folder."""
    real = Path(os.path.realpath(link))  # resolve() raises for a link to itself
    try:
        is_folder = stat.S_ISDIR(real.stat().st_mode)
    except OSError:
        return DamagedData(
            f"{link} is a link to {real}, which is not there",
            hint="mount the disk that it leads to; for a new folder, create it",
        )
    if is_folder and any(
        real.is_relative_to(other) or other.is_relative_to(real) for other in walked
    ):
        return DamagedData(
            f"{link} is a link that leads back into the data root, to {real}",
            hint="remove the link",
        )
    return None
