"""Checks every file of a data root by its path: intact, damaged or foreign."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from kb.artifacts import manifest
from kb.core.errors import DamagedData
from kb.core.sources import SOURCES, SPECS
from kb.store import leftovers
from kb.store.artifact_registry import MANIFEST, rebuild_hint
from kb.store.rawlog import rawlog, sidefiles
from kb.verify import raw, tables
from kb.verify.findings import Findings

# Beside the folders of commands: other roots and what belongs to a checkout.
NEIGHBOURS = {"demo", "dumps", "profiles", "demo-finished", ".gitignore", ".gitkeep"}
_CLEARED = "a killed command left it: `kb verify --repair` or the next command there clears it"
_NEVER_EMPTY = (".json", ".jsonl", ".html", ".png", ".svg")
_OF_STATE = (
    ".lock",
    ".key",
    ".key.sha256",
    ".exported",
    ".repair",
    ".sqlite-wal",
    ".sqlite-shm",
    ".bak",
)


class FileVerifier:
    """Reads files of a data root in full, one after the other."""

    def __init__(self, findings: Findings, root: Path) -> None:
        self._findings, self._root = findings, root
        self._segments = {source: raw.SegmentVerifier(findings, root, source) for source in SOURCES}

    def read(self, files: Iterable[Path]) -> None:
        """Each of them, then what the state knows of raw answers and is not among them."""
        for path in files:
            try:
                self._file(path, path.relative_to(self._root).parts)
            except FileNotFoundError:
                continue  # replaced meanwhile; what is gone for good is told of the whole root
        for segments in self._segments.values():
            segments.end()

    def _file(self, path: Path, parts: tuple[str, ...]) -> None:
        findings = self._findings
        if path.is_symlink() and not path.exists():
            findings.foreign("other", path, "is a link that leads nowhere", "remove it")
        elif leftovers.is_left(parts):
            findings.foreign("leftovers", path, "is a temporary file", _CLEARED)
        elif len(parts) == 1:
            if path.name not in NEIGHBOURS:
                self._strange("other", path)
        elif parts[0] == "raw":
            self._raw(path, parts)
        elif parts[0] == "state":
            self._state(path, parts)
        elif parts[0] in ("annotations", "clean", "pairs", "links"):
            self._made(path, parts)
        elif parts[0] in ("export", "report", "restored"):
            self._plain(path, parts[0])
        elif parts[0] == "index":
            self._index(path, parts)
        elif parts[0] == "release":
            if len(parts) == 2:
                findings.foreign("release", path, "a release is a folder", "move it away")
        else:
            findings.advance(path.stat().st_size)
            self._strange("other", path)

    def _raw(self, path: Path, parts: tuple[str, ...]) -> None:
        findings, known = self._findings, parts[1] in SOURCES
        if known and len(parts) == 3 and path.name.startswith("tombstones"):
            self._parquet("tombstones", path)
        elif known and len(parts) == 4 and path.name.endswith((rawlog.SUFFIX, rawlog.OPEN)):
            self._segments[parts[1]].file(path)
        elif known and len(parts) == 4 and f"{rawlog.SUFFIX}.damaged-" in path.name:
            findings.advance(path.stat().st_size)
            findings.intact("set aside", path)
        elif known and len(parts) > 2 and parts[2] in SPECS[parts[1]].files:
            if path.name.endswith(sidefiles.QUARANTINE_SUFFIX):
                findings.intact("set aside", path)
            else:
                raw.side_file(findings, path)
        else:
            findings.foreign(
                "raw answers", path, "no crawl or import has written it", "move it away"
            )

    def _state(self, path: Path, parts: tuple[str, ...]) -> None:
        name = path.name
        if name.endswith(".sqlite") and len(parts) == 2:
            raw.state(self._findings, path)
        elif name.endswith(".parquet"):
            self._parquet("tombstones" if name == "tombstones.parquet" else "state", path)
        elif name.endswith(".json"):
            self._json("state", path, "move it away, or restore it from a copy")
        elif name.endswith(sidefiles.QUARANTINE_SUFFIX):
            self._findings.intact("set aside", path)
        elif name.endswith((*_OF_STATE, ".txt")) or name == ".gitkeep":
            self._findings.intact("state", path)
        else:
            self._strange("state", path)

    def _made(self, path: Path, parts: tuple[str, ...]) -> None:
        kind = parts[0]
        if path.name.endswith(sidefiles.QUARANTINE_SUFFIX):
            self._findings.intact("set aside", path)
        elif path.suffix == ".parquet" and self._is_listed(path, kind):
            self._parquet(kind, path)
        elif path.suffix == ".json" and (kind != "annotations" or path.name == MANIFEST):
            self._json(kind, path, rebuild_hint(path))
        else:
            self._strange(kind, path)

    def _is_listed(self, path: Path, kind: str) -> bool:
        """Whether a filter says that it wrote a clean file; of other tables all are taken."""
        if kind != "clean":
            return True
        source = path.parent.parent.name
        try:
            known = manifest.read(self._root, f"clean/{source}") if source in SOURCES else None
        except DamagedData:
            return True  # told with the manifest
        return known is None or not known.files or f"{path.parent.name}/{path.name}" in known.files

    def _plain(self, path: Path, kind: str) -> None:
        """Files of other layouts and figures; there are no checksums of these."""
        if path.suffix == ".parquet":
            self._parquet(kind, path)
            return
        size = path.stat().st_size
        self._findings.advance(size)
        what = "" if size or path.suffix not in _NEVER_EMPTY else "is empty"
        self._findings.checked(kind, path, what, rebuild_hint(path))

    def _index(self, path: Path, parts: tuple[str, ...]) -> None:
        """What `kb search` reads; it is made again at any time."""
        findings, rebuild = self._findings, "run `kb index --again`"
        if len(parts) != 3 or parts[1] not in SOURCES:
            self._strange("index", path)
        elif path.name == MANIFEST:
            self._json("index", path, rebuild)
        else:
            findings.advance(path.stat().st_size)
            known = self._manifest_of_index(parts[1])
            if path.name.startswith(".") or known is None:
                return  # tantivy's own locks and lists; an index of an older version
            entry = known.files.get(path.name)
            if entry is None:
                self._strange("index", path)
            else:
                what = "" if manifest.entry_of(path) == entry else "checksum mismatch"
                findings.checked("index", path, what, rebuild)

    def _manifest_of_index(self, source: str) -> manifest.Manifest | None:
        try:
            return manifest.read(self._root, f"index/{source}")
        except DamagedData:
            return None  # told with the manifest

    def _parquet(self, kind: str, path: Path) -> None:
        what = tables.problem(path, self._findings.advance)
        self._findings.checked(kind, path, what, rebuild_hint(path))

    def _json(self, kind: str, path: Path, fix: str) -> None:
        self._findings.checked(kind, path, tables.problem(path, self._findings.advance), fix)

    def _strange(self, kind: str, path: Path) -> None:
        self._findings.foreign(kind, path, "no command has written it", "move it away")
