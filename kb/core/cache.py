"""Folders of the user's cache: made by whoever needs them first, whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path


def cache_root() -> Path:
    """Where models and what is made of them are kept for every data root of this user."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base).absolute() / "lorecrawl"


@contextlib.contextmanager
def making(folder: Path, whole: Callable[[], bool]) -> Iterator[Path]:
    """A fresh folder that becomes `folder` when the block ends well.

    Several processes may make the same one at once (workers of a cluster): the first one's stays,
    if it is `whole`. Raises OSError when the cache can't be written.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    fresh.chmod(0o755)
    try:
        yield fresh
        try:
            os.rename(fresh, folder)
        except OSError:
            if not whole():
                shutil.rmtree(folder, ignore_errors=True)
                os.rename(fresh, folder)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
