"""Verifies a data root, a release folder or a folder of releases."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from kb.artifacts.release_folder import DOWNLOAD
from kb.artifacts.table_catalog import Catalog, empty, existing, is_root
from kb.core.progress import Progress
from kb.verify import cross_checks, releases
from kb.verify.concurrent_writes import Busy
from kb.verify.files import NEIGHBOURS, FileVerifier
from kb.verify.findings import Findings


def verify(folder: Path, progress: Progress) -> Findings:
    """Read every byte of a data root, a release folder or a folder of releases.

    Changes nothing and takes no lock: what other processes write to meanwhile is looked at once
    more, and what is on its way there is not told. Memory is bounded by a piece of a file and the
    names of files. Raises SettingError for a folder that does not exist, FatalError for one that is
    none of these.
    """
    folder = existing(folder)
    catalog = Catalog(folder)
    if not is_root(folder) and not catalog.releases:
        raise empty(folder)
    busy = Busy(folder)  # before the list: what was on its way in it may be finished at once
    files = list(_files(folder))
    size = sum(map(_size, files))
    with progress.task(f"verify {folder.name}", total=size, unit="bytes") as task:
        read = 0

        def advance(n: int) -> None:
            nonlocal read
            read += n
            task.advance(n)

        findings = Findings(advance)
        if is_root(folder):
            _root(findings, folder, files)
            _recheck(findings, folder, busy, progress)
        else:
            for one in catalog.releases:
                releases.folder(findings, one.path, lambda path: DOWNLOAD, described=True)
        task.advance(max(0, size - read))  # locks and lists
    return findings


def _root(findings: Findings, root: Path, files: Iterable[Path]) -> None:
    """Each file by where it is, then what is not there, then what the files say together."""
    FileVerifier(findings, root).read(files)
    cross_checks.compare(findings, root)


def _recheck(findings: Findings, root: Path, busy: Busy, progress: Progress) -> None:
    """Drop findings that another process caused by writing at the same time."""
    doubtful = [one for one in findings.entries if busy.touches(one.path)]
    if not doubtful:
        return
    second = Findings(findings.advance)
    _root(second, root, [path for path in _files(root) if busy.touches(path)])
    confirmed = {(one.kind, one.state, one.path) for one in second.entries}
    unconfirmed = {
        one
        for one in doubtful
        if (one.kind, one.state, one.path) not in confirmed
        or (one.kind == "leftovers" and not busy.is_abandoned(one.path))
    }
    findings.drop(unconfirmed)
    for pid in sorted({pid for one in unconfirmed for pid in busy.holders(one.path)}):
        progress.say(f"another process (pid {pid}) is writing: its unfinished files are not listed")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0  # replaced meanwhile


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
