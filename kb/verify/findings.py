"""The findings of `kb verify`: counts by kind, and damaged, missing and foreign files."""

import copy
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from kb.core import terminal

STATES = ("whole", "damaged", "missing", "foreign")
KINDS = (
    "raw answers",
    "captures",
    "images",
    "tombstones",
    "set aside",
    "state",
    "annotations",
    "clean",
    "pairs",
    "tasks",
    "labels",
    "links",
    "index",
    "release",
    "export",
    "report",
    "restored",
    "leftovers",
    "other",
)
_TRIES = 3  # of a step while files are replaced


class VerifyFinding(NamedTuple):
    """A file (or folder) that is damaged, missing or foreign; `what` says how, `advice` what to do.

    `size` in bytes, 0 for what is missing.
    """

    kind: str
    state: str
    path: Path
    size: int
    what: str
    advice: str


class Findings:
    """Collects findings; `advance` receives the number of bytes that were read."""

    def __init__(self, advance: Callable[[int], None]) -> None:
        self.advance = advance
        self.entries: list[VerifyFinding] = []
        self._counts: dict[str, dict[str, tuple[int, int]]] = {}

    def retrying(self, step: Callable[[], object]) -> None:
        """Retry a step if a file that it reads is replaced meanwhile."""
        for _ in range(_TRIES):
            length, counts = len(self.entries), copy.deepcopy(self._counts)
            try:
                step()
                return
            except FileNotFoundError:
                del self.entries[length:]
                self._counts = counts

    def drop(self, stale: Collection[VerifyFinding]) -> None:
        """Remove findings that no longer apply."""
        for one in stale:
            files, size = self._counts[one.kind][one.state]
            self._counts[one.kind][one.state] = files - 1, size - one.size
            if files == 1:
                del self._counts[one.kind][one.state]
        self.entries = [one for one in self.entries if one not in stale]

    def intact(self, kind: str, path: Path) -> None:
        """Count an intact file."""
        self._count(kind, "whole", path.stat().st_size)

    def checked(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a damaged file if `what` says how it is damaged, else count an intact one."""
        if what:
            self.damaged(kind, path, what, advice)
        else:
            self.intact(kind, path)

    def damaged(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a file whose content differs from what was written."""
        self._add(VerifyFinding(kind, "damaged", path, _size(path), what, advice))

    def missing(self, kind: str, path: Path, advice: str, what: str = "is not there") -> None:
        """Add a file that another file refers to and that does not exist."""
        self._add(VerifyFinding(kind, "missing", path, 0, what, advice))

    def foreign(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a file that no command has written."""
        self._add(VerifyFinding(kind, "foreign", path, _size(path), what, advice))

    def of(self, *kinds: str, state: str = "") -> list[VerifyFinding]:
        """The findings of these kinds."""
        return [one for one in self.entries if one.kind in kinds and state in ("", one.state)]

    def total(self, state: str) -> tuple[int, int]:
        """(files, bytes) in a state."""
        cells = [counts[state] for counts in self._counts.values() if state in counts]
        return sum(files for files, _ in cells), sum(size for _, size in cells)

    def summary(self, folder: Path) -> dict[str, Any]:
        """For `--json`: counts, and each finding."""
        return {
            "folder": str(folder),
            **{f"files_{state}": self.total(state)[0] for state in STATES},
            "bytes": sum(self.total(state)[1] for state in STATES),
            "kinds": {
                kind: {
                    state: {"files": files, "bytes": size}
                    for state, (files, size) in self._counts[kind].items()
                }
                for kind in KINDS
                if self._counts.get(kind)
            },
            "found": [{**one._asdict(), "path": str(one.path)} for one in self.entries],
        }

    def table(self) -> Iterator[tuple[str, ...]]:
        """Lines of cells: a head, a line a kind, all together; files and bytes of each state."""
        yield ("kind", *STATES)
        for kind in KINDS:
            if self._counts.get(kind):
                counts = self._counts[kind]
                yield (kind, *(_cell(*counts.get(state, (0, 0))) for state in STATES))
        yield ("all", *(_cell(*self.total(state)) for state in STATES))

    def _add(self, one: VerifyFinding) -> None:
        self.entries.append(one)
        self._count(one.kind, one.state, one.size)

    def _count(self, kind: str, state: str, size: int) -> None:
        counts = self._counts.setdefault(kind, {})
        files, total = counts.get(state, (0, 0))
        counts[state] = files + 1, total + size


def _size(path: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    if path.is_dir() and not path.is_symlink():
        return sum(_size(below) for below in path.iterdir())
    return path.lstat().st_size if path.is_symlink() or path.exists() else 0


def _cell(files: int, size: int) -> str:
    return f"{files:,} ({terminal.size(size, 1 if size >= 10**12 else 0)})" if files else "-"
