"""Selections of released rows, such as draws of pairs: a purge takes rows out of them, and nothing
makes them again.
"""

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from kb.artifacts.freshness import sources_of
from kb.artifacts.purge_rows import RowLocation
from kb.core.sources import PUBLISHED
from kb.store.artifact_registry import ARTIFACTS, selections
from kb.store.atomic import write_bytes


def selected_from(root: Path, source: str) -> list[str]:
    """The selections of rows that are made of a source, as artifacts."""
    names = (f"release/{name}" for name in selections(root))
    return [name for name in names if source in sources_of(name)]


def locations_in(names: Iterable[str]) -> Iterator[RowLocation]:
    """Where the rows of these selections are."""
    for name in names:
        for declared in ARTIFACTS[name].tables:
            yield RowLocation(name, declared, "video_id")


def drop_described(root: Path, name: str, keys: Collection[str]) -> None:
    """Write a selection's lists of ids without these, and remove what `kb release` wrote about all
    of its rows.
    """
    lists = PUBLISHED[name.partition("/")[2]].lists
    for path in (root / name).iterdir():
        if path.name in lists:
            lines = path.read_text(encoding="utf-8").splitlines()
            left = (f"{line}\n" for line in lines if line not in keys)
            write_bytes(path, "".join(left).encode())
        elif path.suffix != ".parquet":
            path.unlink()
