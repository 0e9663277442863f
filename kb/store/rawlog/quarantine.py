"""Moves unreadable bytes of a raw segment into quarantine files.

raw/<source>/<kind>/….ndjson.zst.damaged-<offset>      the damaged bytes, for whoever can fix them
"""

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from kb.store.atomic import write_bytes, writing
from kb.store.layout import Layout
from kb.store.rawlog import rawlog

_CHUNK = 1 << 16


def gaps(path: Path, committed: int) -> list[tuple[int, int]]:
    """The stretches (start, end) of a segment that hold no readable answer.

    A torn tail of an open segment counts where it begins before `committed`, the offset that the
    state knows; behind it nothing was promised.
    """
    frames = rawlog.Frames(path, mending=True, checked=True)
    for _ in frames:
        pass
    stretches = list(frames.damaged)
    if frames.torn and (not path.name.endswith(".open") or frames.good < committed):
        stretches.append((frames.good, path.stat().st_size))
    return stretches


def quarantine_name(path: Path, start: int, end: int) -> str:
    """The name of the file that gets the damaged bytes of a segment; no reader of raw takes it.

    A file that has these bytes already, of a run that was killed, keeps them.
    """
    first = name = f"{rawlog.base_name(path)}{rawlog.SUFFIX}.damaged-{start}"
    number = 1
    with path.open("rb") as file:
        file.seek(start)
        data = file.read(end - start)
    while (existing := path.with_name(name)).exists() and existing.read_bytes() != data:
        number += 1
        name = f"{first}-{number}"
    return name


def move_out(path: Path, stretches: Sequence[tuple[int, int, str]]) -> None:
    """Take stretches (start, end, name of the new file) out of a segment, which is written anew.

    Raises DiskFull.
    """
    with path.open("rb") as file:
        for start, end, name in stretches:
            file.seek(start)
            write_bytes(path.with_name(name), file.read(end - start))
        with writing(path) as temporary, temporary.open("wb") as fresh:
            at = 0
            for start, end, _ in stretches:
                copy(file, fresh, at, start)
                at = end
            copy(file, fresh, at, path.stat().st_size)


def copy(file: BinaryIO, fresh: BinaryIO, start: int, end: int) -> None:
    """Bytes `start` to `end` of one file at the end of another."""
    file.seek(start)
    left = end - start
    while chunk := file.read(min(_CHUNK, left)):
        fresh.write(chunk)
        left -= len(chunk)


def quarantined_files(root: Path, source: str) -> list[Path]:
    """What was set aside of a source's segments."""
    return sorted(Layout(root).raw(source).glob(f"*/*{rawlog.SUFFIX}.damaged-*"))
