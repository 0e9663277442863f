"""Which files of those that a user names are dumps of posts or comments."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.core.context import Run
from kb.core.errors import SettingError
from kb.reddit.dumps.files import ReadProgress, pieces, read_object, records_of
from kb.store.walk import walk

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
            objects = _first_objects(path)  # raises for a file that is not a dump
            if objects and not any(map(_has_record, objects)):
                raise SettingError(
                    f"{path} is not a dump: it holds objects, and none is a post or comment",
                    hint="name RS_* and RC_* files, or files of one subreddit",
                )
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
    for where, folders, others in walk(folder, strict=False):
        folders[:] = [
            name
            for name in folders
            if not name.startswith(".") and (where / name).resolve() != root
        ]
        for entry in others:
            if not entry.name.startswith("."):
                yield where / entry.name


def _first_objects(file: Path) -> list[dict[str, Any]] | None:
    """The objects at the beginning of a dump; None where nothing can be read, as of one that is
    cut off there. Raises SettingError for a file that is not a dump.
    """
    start = next(pieces(file, ReadProgress()), None)
    return None if start is None else [*filter(None, map(read_object, start.splitlines()))]


def _has_record(line: dict[str, Any]) -> bool:
    return any(
        "subreddit" in record and ("title" in record or "body" in record)
        for record in records_of(line)
    )


def _holds_records(file: Path) -> bool:
    """Whether a file is a dump of posts or comments; a file truncated at its very beginning may be
    one.
    """
    try:
        objects = _first_objects(file)
    except SettingError:
        return False
    return file.stat().st_size > 0 if objects is None else any(map(_has_record, objects))


def holds_dump(path: Path, root: Path) -> bool:
    """Whether this is a dump, or a folder with one that is not in the data root."""
    files = _below(path, root) if path.is_dir() else [path]
    return any(file.is_file() and _holds_records(file) for file in files)
