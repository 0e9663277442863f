"""Release folders as somebody downloaded them: what they are of, and whether they are whole."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, cast

from kb.core.context import Run
from kb.core.errors import DamagedData, SettingError
from kb.core.profile import PROFILE_FILE
from kb.release import checksums
from kb.release.folders import TOMBSTONES
from kb.schema import tables
from kb.store import parquet
from kb.store.digests import SUMS, digest
from kb.store.layout import Layout
from kb.store.reading import reading

_SHARD = re.compile(r"([a-z][a-z0-9_]*)-[0-9]{5}-of-[0-9]{5}\.parquet")
_AGAIN = "download it again, into the same folder"


class Downloaded(NamedTuple):
    """One release folder; `source` is youtube, wiki, reddit, pairs or links."""

    path: Path
    source: str

    def shards(self, short: str) -> list[Path]:
        """The files of a released table."""
        return sorted(self.path.glob(f"{short}-*-of-*.parquet"))

    def removed(self) -> set[str]:
        """Keys that were removed since collection began. Raises DamagedData."""
        path = self.path / TOMBSTONES
        if not path.is_file():
            return set()
        with reading([path]):
            return set(
                cast("list[str]", parquet.read_table(path, columns=["key"])["key"].to_pylist())
            )


Folders = Sequence[Downloaded]


def find(places: Sequence[Path]) -> list[Downloaded]:
    """Release folders that were named, or that lie in one that was. Raises SettingError."""
    releases: dict[Path, Downloaded] = {}
    for place in places:
        mine = list(_of(place))
        if not mine:
            raise SettingError(
                f"{place} is no release folder"
                if place.is_dir()
                else f"there is no folder {place}",
                hint="name a folder with *-00000-of-0000N.parquet and SHA256SUMS in it,"
                " or one that holds such folders",
            )
        releases |= {one.path: one for one in mine}
    return list(releases.values())


def _of(place: Path) -> Iterator[Downloaded]:
    place = place.expanduser().absolute()
    if one := _one(place):
        yield one
        return
    for folder in (place, Layout(place).release()):  # a data root's own
        some = [one for inner in sorted(folder.glob("*/")) if (one := _one(inner))]
        if some:
            yield from some
            return


def _one(folder: Path) -> Downloaded | None:
    of = {declared.short: declared.source for declared in tables().values() if declared.released}
    sources = {
        of[match[1]]
        for path in folder.glob("*.parquet")
        if (match := _SHARD.fullmatch(path.name)) and match[1] in of
    }
    return Downloaded(folder, min(sources)) if len(sources) == 1 else None


def verify(run: Run, releases: Sequence[Downloaded]) -> None:
    """Compare every file with SHA256SUMS. Raises DamagedData for the first that differs."""
    for one in releases:
        sums = _sums(one.path)
        for path in one.path.glob("*.parquet"):
            if path.name not in sums and _SHARD.fullmatch(path.name):
                raise DamagedData(f"{path} is not in {SUMS}", hint=f"remove it, or {_AGAIN}")
        with run.progress.task(f"verify {one.path.name}", len(sums), "files") as task:
            for name, wanted in sums.items():
                path = one.path / name
                if not path.is_file():
                    raise DamagedData(f"{path} is missing", hint=_AGAIN)
                if digest(path) != wanted:
                    raise DamagedData(f"{path} differs from {SUMS}", hint=_AGAIN)
                task.advance()


def _sums(folder: Path) -> dict[str, str]:
    try:
        sums = checksums.read(folder)
    except (OSError, ValueError) as error:
        raise DamagedData(f"{folder / SUMS} can't be read: {error}", hint=_AGAIN) from None
    if not sums:
        raise DamagedData(
            f"{folder} has no {SUMS}, so nobody can tell whether it is whole",
            hint=f"{_AGAIN}; for a folder of your own run `kb release` first",
        )
    return sums


def profile_of(releases: Sequence[Downloaded]) -> Path | None:
    """The profile that the folders were made with; None where none of them holds it."""
    return next((path for one in releases if (path := one.path / PROFILE_FILE).is_file()), None)
