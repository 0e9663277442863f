"""Detects which files other processes write while a data root is read without a lock."""

from pathlib import Path

from kb.core.sources import SOURCES
from kb.store import lock
from kb.store.artifact_registry import artifact_of

_CHECKS = 3


class Busy:
    """Which paths of a data root may have changed since this object was created."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._before = lock.used(root)
        self._held = lock.holders(root)

    def touches(self, path: Path) -> bool:
        """Whether another process holds, or has held since, a lock that covers a path."""
        now = lock.used(self._root)
        moved = {name for name in now if now[name] != self._before.get(name)}
        names = moved | self._held.keys() | lock.holders(self._root).keys()
        return not names.isdisjoint(_locks(path.relative_to(self._root).parts))

    def holders(self, path: Path) -> set[str]:
        """The pids of other processes that hold a lock which covers a path now."""
        holders = lock.holders(self._root)
        return {
            holders[name] for name in _locks(path.relative_to(self._root).parts) if name in holders
        }

    def is_abandoned(self, path: Path) -> bool:
        """Whether a file is there that no process is writing.

        A writer holds the lock for as long as the file exists. So the file is checked before and
        after the lock, and again, as another writer may start at any time.
        """
        return all(
            path.exists() and not self.holders(path) and path.exists() for _ in range(_CHECKS)
        )


def _locks(parts: tuple[str, ...]) -> tuple[str, ...]:
    """The locks under which a path is written (kb.store.lock); all where it may be any."""
    # `.youtube.new` and `youtube.sqlite` belong to youtube
    place, *rest = bare = [name.lstrip(".").partition(".")[0] for name in parts]
    if match := artifact_of(Path(*bare)):
        return (match[1].lock,)
    return (rest[0],) if place in ("raw", "state") and rest[0] in SOURCES else lock.ORDER
