"""The indexes of `kb search`: which texts they are made from, and whether they can be used.

An index can be made again at any time, so whoever changes the texts removes one that is out of
date: a purge at once (`remove`), a filter where its texts have changed (`remove_stale`). Call both
under the source's lock (kb.store.lock.of_clean).
"""

from pathlib import Path

from kb.artifacts import manifest, texts
from kb.artifacts.table_catalog import Catalog
from kb.core.errors import DamagedData
from kb.store.artifact_registry import ARTIFACTS, MANIFEST
from kb.store.atomic import remove_path
from kb.store.layout import Layout

LOCKS = (".tantivy-meta.lock", ".tantivy-writer.lock")  # empty files, not part of an index
_LARGE = 256 << 20  # bytes; a larger index is not read as a whole before it is asked

_verified: set[frozenset[tuple[str, int, int, int]]] = set()  # files that this process has read


def home(root: Path, source: str) -> Path:
    """The folder that the index is below: the data root; one of the user's cache for a download,
    and for a data root that can't be written and has no current one.
    """
    catalog = Catalog(root.absolute())
    if catalog.is_writable:
        return catalog.path
    places = [] if catalog.is_download else [catalog.cached, catalog.path]
    return next((place for place in places if _is_current(catalog, place, source)), catalog.cached)


def folder(root: Path, source: str) -> Path:
    """Where the index is."""
    return Layout(home(root, source)).index(source)


def known(root: Path, source: str) -> manifest.Manifest | None:
    """What the index was made from; None where there is none. Raises DamagedData."""
    return manifest.read_manifest(home(root, source), f"index/{source}")


def is_current(root: Path, source: str, catalog: Catalog | None = None) -> bool:
    """Whether the index was made from the texts that are there now; `catalog` is that of the root,
    where it was read already. Raises DamagedData.
    """
    return _is_current(catalog or Catalog(root.absolute()), home(root, source), source)


def _is_current(catalog: Catalog, place: Path, source: str) -> bool:
    name = f"index/{source}"
    made = manifest.read_manifest(place, name)
    return made is not None and made.inputs == texts.inputs(catalog.path, name, catalog)


def remove(root: Path, source: str) -> None:
    """Remove the index; no byte of it stays."""
    catalog = Catalog(root.absolute())
    for place in (Layout(root).index(source) for root in (catalog.workplace, catalog.cached)):
        (place / MANIFEST).unlink(missing_ok=True)  # from here on there is no index
        remove_path(place)


def remove_stale(root: Path, source: str) -> None:
    """Remove an index that was made from other texts than those that are there now."""
    if not is_current(root, source):
        remove(root, source)


def verify_index(root: Path, source: str) -> None:
    """Raises DamagedData for an index whose files are missing or differ from what was written.

    A large one is not read for that: `kb verify` does it.
    """
    place = folder(root, source)
    made = known(root, source)
    if made is None:
        return
    now = [(path.name, path.stat()) for path in _files(place)]
    mark = frozenset((name, it.st_ino, it.st_size, it.st_mtime_ns) for name, it in now)
    if mark in _verified:
        return
    read = sum(entry.size for entry in made.files.values()) <= _LARGE
    if damage := damaged(place, made, read=read):
        raise DamagedData(damage, hint=ARTIFACTS[f"index/{source}"].hint)
    _verified.add(mark)


def damaged(place: Path, known: manifest.Manifest, *, read: bool = True) -> str:
    """What is wrong with the files of an index; "" for an intact one."""
    for name, entry in known.files.items():
        path = place / name
        if not path.is_file():
            return f"{path} is missing"
        if path.stat().st_size != entry.size or (read and manifest.entry_of(path) != entry):
            return f"{path} has a checksum mismatch"
    return ""


def has_unknown_files(place: Path, known: manifest.Manifest) -> bool:
    """Whether a file lies in an index that no command has written."""
    return any(path.name not in known.files for path in _files(place))


def _files(place: Path) -> list[Path]:
    there = sorted(place.iterdir()) if place.is_dir() else []
    return [path for path in there if path.name != MANIFEST and not path.name.startswith(".")]
