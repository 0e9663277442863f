"""Release folders: those of a data root, what `kb release` writes into them beside the data, and
those that somebody downloaded.
"""

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from kb.artifacts import release_folder
from kb.artifacts.release_folder import (
    KEYWORDS,
    TOMBSTONES,
    ReleaseFolder,
    entries,
    read_release_folder,
)
from kb.artifacts.table_catalog import Catalog
from kb.core.context import Run
from kb.core.errors import DamagedData, SettingError
from kb.core.installation import PROFILE_FILE
from kb.core.licences import KNOWN
from kb.core.sources import PUBLISHED, SELECTIONS, selection_of
from kb.schema import Table, released_tables
from kb.store.artifact_registry import SUMS, selections
from kb.store.atomic import write_bytes
from kb.store.damage import DOWNLOAD, missing, opening
from kb.store.layout import Layout
from kb.store.tables import parquet
from kb.store.tables.checksums import digest, read_small

Folders = Sequence[ReleaseFolder]

DEPOSIT = "zenodo.json"
# What `kb release` writes into every folder, and what only into some.
REQUIRED = (
    *("README.md", "DATASHEET.md", "CITATION.cff", "LICENSE", "croissant.json"),
    *(PROFILE_FILE, "provenance.json", DEPOSIT, SUMS),
)
OPTIONAL = (TOMBSTONES, KEYWORDS)
RECIPES = "recipe-*.txt"  # texts of the user's own recipes, which nothing runs


def in_root(root: Path) -> list[ReleaseFolder]:
    """The folders under `release/` that an export has filled, in the contract's order."""
    at = Layout(root)
    folders = [
        read_release_folder(at.release(one), one) for one in PUBLISHED if one not in SELECTIONS
    ]
    folders += [
        read_release_folder(at.release(name), selection_of(name) or name)
        for name in selections(root)
    ]
    return [folder for folder in folders if folder.data]


def strays(folder: ReleaseFolder) -> list[Path]:
    """Files that neither an export nor a release writes, and every link."""
    data = set(folder.data)
    return [
        file
        for file in entries(folder.path)
        if file.is_symlink() or not (file in data or is_made(file.name, folder.source))
    ]


def samples(folder: ReleaseFolder) -> list[tuple[Table, Path]]:
    """Samples with the tables that they are of: JSON files."""
    named = {sample_name(declared): declared for declared in released_tables(folder.source)}
    return [(named[path.name], path) for path in folder.files() if path.name in named]


def is_made(name: str, source: str) -> bool:
    """Whether `kb release` writes a file of that name into the source's folder."""
    licences = {f"LICENSE-{spdx}.txt" for spdx in KNOWN}
    samples_ = {sample_name(declared) for declared in released_tables(source)}
    is_recipe = fnmatch(name, RECIPES)
    return is_recipe or name in {*REQUIRED, *OPTIONAL, *licences, *samples_}


def sample_name(declared: Table) -> str:
    return f"{declared.short}.sample.json"


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
        releases |= {folder.path: folder for folder in mine}
    return list(releases.values())


def verify(run: Run, releases: Folders) -> None:
    """Compare every file with SHA256SUMS, and tables with what schemas/ declare. Raises DamagedData
    for the first that differs.
    """
    for folder in releases:
        sums = _sums(folder.path)
        folder.require_tables()
        for path in folder.data:
            if path.name not in sums and path.suffix == ".parquet":
                raise DamagedData(f"{path} is not in {SUMS}", hint=f"remove it, or {DOWNLOAD}")
        with run.progress.task(f"verify {folder.path.name}", len(sums), "files") as task:
            for name, wanted in sums.items():
                path = folder.path / name
                if not path.exists():
                    raise missing([path], DOWNLOAD)
                with opening(path, hint=DOWNLOAD):
                    actual = digest(path)
                if actual != wanted:
                    raise DamagedData(f"{path} differs from {SUMS}", hint=DOWNLOAD)
                task.advance()
        parquet.check_release(*(shard for part in folder.parts for shard in part.shards))


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
    """Copy the releases' profile and keywords next to the restored data, for later commands."""
    own = profile_of(releases)
    for path in (own, own.with_name(KEYWORDS)) if own else ():
        if path.is_file():
            write_bytes(Layout(root).restored() / path.name, read_small(path, DOWNLOAD))


def profile_of(releases: Folders) -> Path | None:
    """The profile that the folders were made with; None where none of them holds it."""
    return next((folder.profile for folder in releases if folder.profile), None)
