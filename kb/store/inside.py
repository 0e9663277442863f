"""Paths that stand in data are data: none names a place outside of the folder it belongs to."""

from __future__ import annotations

from pathlib import Path

from kb.core.errors import DamagedData
from kb.store.layout import CAPTURED, Layout


def is_inside(root: Path, path: str) -> bool:
    """Whether `path`, relative to the data root, leads into raw/wiki, links resolved.

    Captured pages and images are there.
    """
    return (root / path).resolve().is_relative_to(Layout(root).raw(CAPTURED).resolve())


def inside(root: Path, path: str) -> Path:
    """The place of `path`. Raises DamagedData where it is not in raw/wiki."""
    if not is_inside(root, path):
        raise DamagedData(
            f"the wiki's data name {path!r}, which is not in {Layout(root).raw(CAPTURED)}",
            hint="those raw files are not from a crawl: move them away",
        )
    return root / path
