"""The release folders of a data root, and what `kb release` writes into them beside the data."""

from pathlib import Path

from kb.artifacts.release_folder import EARLIER_TOMBSTONES, TOMBSTONES, ReleaseFolder, entries, read
from kb.core.installation import PROFILE_FILE
from kb.core.licences import KNOWN
from kb.core.sources import PUBLISHED
from kb.schema import Table, released_tables
from kb.store.layout import Layout
from kb.store.tables.checksums import SUMS

DEPOSIT = "zenodo.json"
# What `kb release` writes into every folder, and what only into some.
REQUIRED = (
    *("README.md", "DATASHEET.md", "CITATION.cff", "LICENSE", "croissant.json"),
    *(PROFILE_FILE, "provenance.json", DEPOSIT, SUMS),
)
OPTIONAL = (TOMBSTONES, EARLIER_TOMBSTONES, "keywords.tsv")


def find(root: Path) -> list[ReleaseFolder]:
    """The folders under `release/` that an export has filled, in the contract's order."""
    folders = (read(Layout(root).release(source), source) for source in PUBLISHED)
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
    named = {sample_name(one): one for one in released_tables(folder.source)}
    return [(named[path.name], path) for path in folder.files() if path.name in named]


def is_made(name: str, source: str) -> bool:
    """Whether `kb release` writes a file of that name into the source's folder."""
    licences = {f"LICENSE-{spdx}.txt" for spdx in KNOWN}
    samples_ = {sample_name(declared) for declared in released_tables(source)}
    return name in {*REQUIRED, *OPTIONAL, *licences, *samples_}


def sample_name(declared: Table) -> str:
    """The file with some rows of a table."""
    return f"{declared.short}.sample.json"
