"""Which dumps an import or a reconstruction reads: named files, and dumps in named folders."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from kb.core.context import Run
from kb.core.errors import SettingError
from kb.reddit.dumps import containers
from kb.reddit.dumps.chunks import read_object
from kb.reddit.dumps.containers import ReadProgress

Dumps = Sequence[Path]  # archive files to read instead of asking Reddit
_SHOWN = 3  # names of foreign files in a message


class DumpFiles(NamedTuple):
    """Dumps to read, and how many other files the searched folders contain."""

    files: list[Path]
    foreign: int


def find_dumps(run: Run, paths: Sequence[Path]) -> DumpFiles:
    """The named files, and all dumps below the named folders in the order of their paths.

    Content decides which files are dumps. Other files in a folder are counted and named; hidden
    files and the run's own data root are skipped. Raises SettingError for a named file that is not
    a dump and for a folder without dumps.
    """
    files: list[Path] = []
    foreign = 0
    for path in paths:
        if not path.is_dir():
            containers.check(path)
            files.append(path)
            continue
        there = list(_below(path, run.root.resolve()))
        dumps = [file for file in there if _holds_records(file)]
        others = sorted(set(there) - set(dumps))
        if not dumps:
            raise SettingError(
                f"{path} contains no dumps ({len(others)} other files)",
                hint="name a folder of RS_* and RC_* files, or of files of one subreddit",
            )
        if others:
            names = ", ".join(file.name for file in others[:_SHOWN])
            more = ", …" if len(others) > _SHOWN else ""
            run.progress.say(f"{path}: skipped {len(others)} files without posts: {names}{more}")
        files += dumps
        foreign += len(others)
    return DumpFiles(files, foreign)


def _below(folder: Path, root: Path) -> Iterator[Path]:
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(
            name
            for name in folders
            if not name.startswith(".") and Path(place, name).resolve() != root
        )
        for name in sorted(names):
            if not name.startswith(".") and Path(place, name).is_file():
                yield Path(place, name)


def _holds_records(file: Path) -> bool:
    """Whether a file is a dump of posts or comments; a file truncated at its very beginning may be
    one.
    """
    try:
        start = next(containers.pieces(file, ReadProgress()), None)
    except SettingError:
        return False
    if start is None:
        return file.stat().st_size > 0
    records = filter(None, map(read_object, start.splitlines()))
    return any("subreddit" in one and ("title" in one or "body" in one) for one in records)
