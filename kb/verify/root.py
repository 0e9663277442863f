"""Every file of a data root, by what it is; or of a release folder, or of a folder of releases."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from kb.core.errors import UsageError
from kb.core.progress import Progress
from kb.verify import releases, together
from kb.verify.busy import Busy
from kb.verify.files import NEIGHBOURS, Files
from kb.verify.found import Look

_DOWNLOAD = "download it again, into the same folder"


def verify(folder: Path, progress: Progress) -> Look:
    """Read every byte of a data root, a release folder or a folder of releases.

    Changes nothing and takes no lock: what other processes write to meanwhile is looked at once
    more, and what is on its way there is not told. Memory is bounded by a piece of a file and the
    names of files. Raises UsageError for a folder that is none of these.
    """
    folder = folder.absolute()
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}", hint="check --data or the folder's name")
    several = [one for one in sorted(folder.iterdir()) if one.is_dir() and releases.is_release(one)]
    of_root = is_root(folder)
    busy = Busy(folder)  # before the list: what was on its way in it may be finished at once
    files = list(_files(folder))
    size = sum(map(_size, files))
    with progress.task(f"verify {folder.name}", total=size, unit="bytes") as task:
        read = 0

        def advance(n: int) -> None:
            nonlocal read
            read += n
            task.advance(n)

        look = Look(advance)
        if releases.is_release(folder) and not of_root:
            releases.folder(look, folder, lambda path: _DOWNLOAD, described=True)
        elif several and not of_root:
            for one in several:
                releases.folder(look, one, lambda path: _DOWNLOAD, described=True)
        elif of_root:
            _root(look, folder, files)
            _look_again(look, folder, busy, progress)
        else:
            raise UsageError(
                f"{folder} is neither a data root nor a release",
                hint="give the folder with SHA256SUMS, one that holds such folders, or a data root",
            )
        task.advance(max(0, size - read))  # locks and lists
    return look


def _root(look: Look, root: Path, files: Iterable[Path]) -> None:
    """Each file by where it is, then what is not there, then what the files say together."""
    Files(look, root).read(files)
    together.compare(look, root)


def _look_again(look: Look, root: Path, busy: Busy, progress: Progress) -> None:
    """Drop what was found only because another process was writing there."""
    doubtful = [one for one in look.found if busy.touches(one.path)]
    if not doubtful:
        return
    second = Look(look.advance)
    _root(second, root, [path for path in _files(root) if busy.touches(path)])
    again = {(one.kind, one.state, one.path) for one in second.found}
    held = {
        one
        for one in doubtful
        if (one.kind, one.state, one.path) not in again
        or (one.kind == "leftovers" and not busy.is_abandoned(one.path))
    }
    look.drop(held)
    for pid in sorted({pid for one in held for pid in busy.holders(one.path)}):
        progress.say(f"another process (pid {pid}) is writing: what is on its way is not told")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0  # replaced meanwhile


def is_root(folder: Path) -> bool:
    """Whether a folder is a data root; a folder of releases may have one named "pairs"."""
    return any((folder / name).is_dir() for name in ("raw", "state", "clean", "release"))


def _files(folder: Path) -> Iterator[Path]:
    """Every file below a folder, through links to folders too, each place once."""
    seen = set()
    for where, folders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(where)
        if real in seen:
            folders.clear()
            continue
        seen.add(real)
        if Path(where) == folder:
            folders[:] = [name for name in folders if name not in NEIGHBOURS]
        folders.sort()
        yield from (Path(where, name) for name in sorted(names))
