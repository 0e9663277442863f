"""Checks every file of a data root by its path: intact, damaged or foreign.

A file of an artifact is what the artifact's manifest lists, byte for byte. Files that no manifest
describes are read in full instead.
"""

import json
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

from kb.artifacts import manifest
from kb.artifacts.release_folder import OVERVIEW
from kb.core.errors import DamagedData
from kb.core.regular_file import NotRegular, check_regular
from kb.core.sources import SOURCES
from kb.store import leftovers
from kb.store.artifact_registry import MANIFEST, Artifact, artifact_of
from kb.store.damage import remedy
from kb.store.layout import Layout
from kb.store.rawlog import sidefiles
from kb.store.rawlog.raw_files import RawKind, kind_of
from kb.store.state import demo_mark
from kb.store.tables import checksums
from kb.store.tables.reading import broken
from kb.verify import raw
from kb.verify.findings import KINDS, Findings

# Beside the folders of commands: other roots and what belongs to a checkout.
NEIGHBOURS = {"demo", "dumps", "profiles", demo_mark.NAME, ".gitignore", ".gitkeep"}
_OF_STATE = (
    *(".lock", ".key", ".exported", ".txt"),
    *(".sqlite-wal", ".sqlite-shm", ".bak"),
    ".stamps",  # of imported files
    *(".arrow", ".npy"),  # of artifacts on their way
)
_NEVER_EMPTY = (".json", ".html", ".parquet", ".png", ".svg")


def irregular(path: Path) -> str:
    """What a path is that is no regular file, "" for one and where nothing is."""
    try:
        check_regular(path)
    except NotRegular as error:
        return str(error.strerror)
    except OSError:
        return ""
    return ""


def problem(path: Path, advance: Callable[[int], None]) -> str:
    """What is wrong with a file, "" when nothing is. Every byte is read.

    It is compared with its digest where a manifest or SHA256SUMS has one. Otherwise every page of a
    Parquet file is decoded, and JSON is parsed.
    """
    size = path.stat().st_size
    if (entry := checksums.recorded(path)) is not None:
        return "" if checksums.digest(path, advance=advance) == entry.sha256 else checksums.MISMATCH
    advance(size)
    if not size and path.suffix in _NEVER_EMPTY:
        return "is empty"
    if path.suffix == ".parquet":
        damage = broken([path])
        return "" if damage is None else str(damage).removeprefix(f"{path} ")
    if path.suffix == ".json":
        try:
            json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            return f"can't be read: {error}"
    return ""


class FileVerifier:
    """Reads files of a data root in full, one after the other."""

    def __init__(self, findings: Findings, root: Path) -> None:
        self._findings, self._root = findings, root
        self._segments = {source: raw.SegmentVerifier(findings, root, source) for source in SOURCES}

    def verify_files(self, files: Iterable[Path]) -> None:
        """Check each file, then report segments that the state knows and that are missing."""
        for path in files:
            try:
                self._file(path, path.relative_to(self._root).parts)
            except FileNotFoundError:
                continue  # replaced meanwhile; cross_checks reports what is missing for good
        for segments in self._segments.values():
            segments.end()

    def _file(self, path: Path, parts: tuple[str, ...]) -> None:
        findings = self._findings
        if path.is_symlink() and not path.exists():
            hint = "mount the disk that it leads to, or remove it"
            findings.foreign("other", path, "is a link that leads nowhere", hint)
        elif path.is_symlink() and path.is_dir():  # others are walked through
            findings.foreign("other", path, "is a link back into the data root", "remove it")
        elif leftovers.is_left(parts):
            hint = "run `kb verify --repair` or the next command on this folder, which removes it"
            findings.foreign("leftovers", path, "is a temporary file", hint)
        elif what := irregular(path):
            kind = "raw answers" if parts[0] == "raw" else parts[0]
            self._foreign(kind if kind in KINDS else "other", path, what)
        elif parts[0] == "raw":
            self._raw(path, parts)
        elif parts[0] == "state":
            self._state(path, parts)
        elif parts[0] == "release":
            if len(parts) == 2 and path.name != OVERVIEW:  # kb.verify.root checks the folders
                findings.foreign("release", path, "a release is a folder", "move it away")
        elif match := artifact_of(path):
            self._artifact(path, match[1])
        elif path.name not in NEIGHBOURS:
            findings.advance(path.stat().st_size)
            self._foreign(parts[0] if parts[0] in KINDS else "other", path)

    def _raw(self, path: Path, parts: tuple[str, ...]) -> None:
        findings = self._findings
        match kind_of(parts[1], Path(*parts[2:])):
            case RawKind.TOMBSTONES:
                self._checked("tombstones", path)
            case RawKind.KEY_MARK:
                findings.intact("state", path)
            case RawKind.SEGMENT:
                self._segments[parts[1]].file(path)
            case RawKind.SET_ASIDE:
                findings.advance(path.stat().st_size)
                findings.intact("set aside", path)
            case RawKind.CAPTURED:
                raw.side_file(findings, path)
            case RawKind.FOREIGN:
                of = SOURCES[parts[1]].files if parts[1] in SOURCES else ()
                kind = (
                    raw.captured_kind(path) if len(parts) > 2 and parts[2] in of else "raw answers"
                )
                self._foreign(kind, path, "no crawl or import has written it")

    def _state(self, path: Path, parts: tuple[str, ...]) -> None:
        if path.suffix == ".sqlite" and len(parts) == 2:
            raw.state(self._findings, path)
        elif path.suffix in (".parquet", ".json"):
            self._checked("state", path)
        elif path.name.endswith(sidefiles.QUARANTINE_SUFFIX):
            self._findings.intact("set aside", path)
        elif (
            path.is_relative_to(Layout(self._root).kept_profile)
            or path.name.endswith(_OF_STATE)
            or path.name == ".gitkeep"
        ):
            self._findings.intact("state", path)
        else:
            self._foreign("state", path)

    def _artifact(self, path: Path, artifact: Artifact) -> None:
        kind = artifact.name.partition("/")[0]
        if path.name.endswith(sidefiles.QUARANTINE_SUFFIX):
            self._findings.intact("set aside", path)
        elif path.name == MANIFEST or self._is_listed(path, artifact):
            self._checked(kind, path)
        elif kind == "index" and path.name.startswith("."):
            self._findings.advance(path.stat().st_size)  # tantivy's own locks and lists
        else:
            self._foreign(kind, path)

    def _is_listed(self, path: Path, artifact: Artifact) -> bool:
        """Whether the artifact's manifest lists a file, or could list it where it lists none."""
        listed = self._listed(artifact.name)
        if artifact.public or not listed:
            return not artifact.tables or path.suffix in (".parquet", ".json")
        name = path.relative_to(artifact.folder(self._root)).as_posix()
        is_old = not artifact.manifest(self._root).is_file()
        return name in listed or (is_old and path.suffix == ".json")

    @cache  # noqa: B019  a verifier ends with its command
    def _listed(self, name: str) -> frozenset[str]:
        try:
            known = manifest.read_manifest(self._root, name)
        except DamagedData:
            known = None  # reported with the manifest itself
        return frozenset(known.files if known is not None else ())

    def _checked(self, kind: str, path: Path) -> None:
        what = problem(path, self._findings.advance)
        self._findings.checked(kind, path, what, remedy(path))

    def _foreign(self, kind: str, path: Path, what: str = "no command has written it") -> None:
        self._findings.foreign(kind, path, what, "move it away")
