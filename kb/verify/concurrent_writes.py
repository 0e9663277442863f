"""Detects which files other processes write while a data root is read without a lock."""

from __future__ import annotations

from pathlib import Path

from kb.core.sources import PUBLISHED, SOURCES
from kb.store import lock

_CHECKS = 3


class Busy:
    """Which places of a data root may have changed since this was made."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._before = lock.used(root)
        self._held = lock.holders(root)

    def touches(self, path: Path) -> bool:
        """Whether another process holds, or held meanwhile, a lock of a path's place."""
        now = lock.used(self._root)
        moved = {name for name in now if now[name] != self._before.get(name)}
        names = moved | self._held.keys() | lock.holders(self._root).keys()
        return not names.isdisjoint(_locks(path.relative_to(self._root).parts))

    def holders(self, path: Path) -> set[str]:
        """The pids of other processes that hold a lock of a path's place now."""
        holders = lock.holders(self._root)
        return {
            holders[name] for name in _locks(path.relative_to(self._root).parts) if name in holders
        }

    def is_abandoned(self, path: Path) -> bool:
        """Whether a file is there that no process is writing.

        Who writes one takes the lock before and gives it back after it is gone, so it is looked at
        on both sides of asking for the lock, and again, as the next one may begin at any time.
        """
        return all(
            path.exists() and not self.holders(path) and path.exists() for _ in range(_CHECKS)
        )


def _locks(parts: tuple[str, ...]) -> tuple[str, ...]:
    """The locks under which a path is written (kb.store.lock); all where it may be any."""
    place, rest = _bare(parts[0]), [_bare(name) for name in parts[1:]]
    source = rest[0] if rest else ""
    if place in ("raw", "annotations", "clean") and source in SOURCES:
        return (source,)
    if place == "state" and source in SOURCES:
        return (source,)
    if place in ("pairs", "restored", "report"):
        return (place,)
    if place == "release" and source in PUBLISHED:
        return (f"release-{source}",)
    if place == "index" and source in SOURCES:
        return (f"index-{source}",)
    return lock.ORDER


def _bare(name: str) -> str:
    """The name of what is written: of `.youtube.new` and `youtube.sqlite` it is youtube."""
    return name.lstrip(".").partition(".")[0]
