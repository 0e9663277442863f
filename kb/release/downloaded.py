"""Release folders as somebody downloaded them: what they are of, and whether they are whole."""

from collections.abc import Sequence
from pathlib import Path

from kb.artifacts import release_folder
from kb.artifacts.release_folder import DOWNLOAD, ReleaseFolder
from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.errors import DamagedData, SettingError
from kb.store.atomic import write_bytes
from kb.store.layout import Layout
from kb.store.tables.checksums import SUMS, digest

Folders = Sequence[ReleaseFolder]


def find(places: Sequence[Path]) -> list[ReleaseFolder]:
    """Release folders that were named, or that lie in one that was. Raises SettingError."""
    releases: dict[Path, ReleaseFolder] = {}
    for place in places:
        mine = Catalog(place.expanduser().absolute()).releases
        if not mine:
            raise SettingError(
                f"{place} is not a release folder"
                if place.is_dir()
                else f"there is no folder {place}",
                hint="name a folder with *-00000-of-0000N.parquet and SHA256SUMS in it,"
                " or one that holds such folders",
            )
        releases |= {one.path: one for one in mine}
    return list(releases.values())


def verify(run: Run, releases: Folders) -> None:
    """Compare every file with SHA256SUMS. Raises DamagedData for the first that differs."""
    for one in releases:
        sums = _sums(one.path)
        for path in one.data:
            if path.name not in sums and path.suffix == ".parquet":
                raise DamagedData(f"{path} is not in {SUMS}", hint=f"remove it, or {DOWNLOAD}")
        with run.progress.task(f"verify {one.path.name}", len(sums), "files") as task:
            for name, wanted in sums.items():
                path = one.path / name
                if not path.is_file():
                    raise DamagedData(f"{path} is missing", hint=DOWNLOAD)
                if digest(path) != wanted:
                    raise DamagedData(f"{path} differs from {SUMS}", hint=DOWNLOAD)
                task.advance()


def _sums(folder: Path) -> dict[str, str]:
    sums, invalid = release_folder.sums(folder)
    if invalid:
        raise DamagedData(f"{folder / SUMS} is not a list of checksums", hint=DOWNLOAD)
    if not sums:
        raise DamagedData(
            f"{folder} has no {SUMS}, so its files can't be checked",
            hint=f"{DOWNLOAD}; for a folder of your own run `kb release` first",
        )
    return sums


def keep_profile(root: Path, releases: Folders) -> None:
    """Copy the releases' profile and keywords beside what is restored, which later commands read
    with them.
    """
    own = profile_of(releases)
    for path in (own, own.with_name("keywords.tsv")) if own else ():
        if path.is_file():
            write_bytes(Layout(root).restored() / path.name, path.read_bytes())


def profile_of(releases: Folders) -> Path | None:
    """The profile that the folders were made with; None where none of them holds it."""
    return next((one.profile for one in releases if one.profile), None)
