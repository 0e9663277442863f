"""The findings of `kb verify`: counts by kind, and damaged, missing and foreign files."""

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
    "films",
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
        self._intact: dict[str, tuple[int, int]] = {}  # files and bytes by kind

    def retrying(self, step: Callable[[], object]) -> None:
        """Retry a step if a file that it reads is replaced meanwhile."""
        for _ in range(_TRIES):
            length, intact = len(self.entries), dict(self._intact)
            try:
                step()
                return
            except FileNotFoundError:
                del self.entries[length:]
                self._intact = intact

    def drop(self, stale: Collection[VerifyFinding]) -> None:
        """Remove findings that no longer apply."""
        self.entries = [finding for finding in self.entries if finding not in stale]

    def intact(self, kind: str, path: Path) -> None:
        """Count an intact file."""
        files, size = self._intact.get(kind, (0, 0))
        self._intact[kind] = files + 1, size + path.stat().st_size

    def checked(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a damaged file if `what` says how it is damaged, else count an intact one."""
        if what:
            self.damaged(kind, path, what, advice)
        else:
            self.intact(kind, path)

    def damaged(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a file whose content differs from what was written."""
        self.entries.append(VerifyFinding(kind, "damaged", path, _size(path), what, advice))

    def missing(self, kind: str, path: Path, advice: str, what: str = "is not there") -> None:
        """Add a file that another file refers to and that does not exist."""
        self.entries.append(VerifyFinding(kind, "missing", path, 0, what, advice))

    def foreign(self, kind: str, path: Path, what: str, advice: str) -> None:
        """Add a file that no command has written."""
        self.entries.append(VerifyFinding(kind, "foreign", path, _size(path), what, advice))

    def of_kinds(self, *kinds: str, state: str = "") -> list[VerifyFinding]:
        """The findings of these kinds."""
        return [
            finding
            for finding in self.entries
            if finding.kind in kinds and state in ("", finding.state)
        ]

    def total(self, state: str, kinds: Collection[str] = KINDS) -> tuple[int, int]:
        """(files, bytes) of these kinds in a state."""
        if state == "whole":
            sizes = [self._intact[kind] for kind in kinds if kind in self._intact]
        else:
            sizes = [(1, finding.size) for finding in self.of_kinds(*kinds, state=state)]
        return sum(files for files, _ in sizes), sum(size for _, size in sizes)

    def _by_kind(self) -> dict[str, dict[str, tuple[int, int]]]:
        """(files, bytes) by kind and state, without those that have none."""
        counts = {kind: {state: self.total(state, [kind]) for state in STATES} for kind in KINDS}
        some = {
            kind: {state: count for state, count in states.items() if count[0]}
            for kind, states in counts.items()
        }
        return {kind: states for kind, states in some.items() if states}

    def summary(self, folder: Path) -> dict[str, Any]:
        """For `--json`: counts, and each finding."""
        return {
            "folder": str(folder),
            **{f"files_{state}": self.total(state)[0] for state in STATES},
            "bytes": sum(self.total(state)[1] for state in STATES),
            "kinds": {
                kind: {
                    state: {"files": files, "bytes": size}
                    for state, (files, size) in states.items()
                }
                for kind, states in self._by_kind().items()
            },
            "found": [{**finding._asdict(), "path": str(finding.path)} for finding in self.entries],
        }

    def table(self) -> Iterator[tuple[str, ...]]:
        """Lines of cells: a head, a line a kind, all together; files and bytes of each state."""
        yield ("kind", *STATES)
        for kind, counts in self._by_kind().items():
            yield (kind, *(_cell(*counts.get(state, (0, 0))) for state in STATES))
        yield ("all", *(_cell(*self.total(state)) for state in STATES))


def _size(path: Path) -> int:
    """Bytes of a file, or of all files below a folder, as far as it can be read."""
    if path.is_dir() and not path.is_symlink():
        return sum(_size(below) for below in path.glob("*"))
    return path.lstat().st_size if path.is_symlink() or path.exists() else 0


def _cell(files: int, size: int) -> str:
    return f"{files:,} ({terminal.size(size, 1 if size >= 10**12 else 0)})" if files else "-"
