"""Checks raw answers against their checksums and the state, and captured pages and images."""

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import zstandard

from kb.core.errors import FatalError
from kb.core.regular_file import read_regular
from kb.store.layout import BELOW, CAPTURED, Layout
from kb.store.rawlog import quarantine, rawlog, sidefiles
from kb.store.state.crawl_state import REBUILT
from kb.store.tables import reading
from kb.verify.findings import Findings


class _Extraction(msgspec.Struct):
    sprites: dict[str, str] = {}


class SegmentVerifier:
    """The segments of a source. What the state knows is read first: a crawl may add meanwhile."""

    def __init__(self, findings: Findings, root: Path, source: str) -> None:
        self._findings, self._root, self._source = findings, root, source
        self._known, self._lost = self._read_state()
        self._crawl = f"run `kb verify --repair`, then `kb {source} crawl`, which fetches it again"

    def file(self, path: Path) -> None:
        """Read a segment in full."""
        findings, name, size = self._findings, rawlog.base_name(path), path.stat().st_size
        committed = self._known.pop((path.parent.name, name), 0)
        lost = quarantine.lost_of(path, committed)
        findings.advance(size)
        what = lost[0].what if lost else ""
        more = f" (and {len(lost) - 1:,} more places)" if len(lost) > 1 else ""
        findings.checked("raw answers", path, what + more, self._crawl)

    def end(self) -> None:
        """What the state knows and is not there, and what was lost and not asked for again."""
        for (kind, name), committed in self._known.items():
            if committed:
                path = rawlog.folder(self._root, self._source, kind) / f"{name}{rawlog.SUFFIX}"
                self._findings.missing("raw answers", path, self._crawl)
        if self._lost:
            error = quarantine.damage_of(self._root, self._source, [], self._lost)
            base = Layout(self._root).raw(self._source)
            self._findings.missing("raw answers", base, error.hint, str(error))

    def _read_state(self) -> tuple[dict[tuple[str, str], int], list[tuple[str, str]]]:
        path = Layout(self._root).state(self._source)
        if path.is_file():
            with suppress(FatalError, sqlite3.Error), reading.state(path) as frontier:
                return dict(frontier.offsets()), frontier.lost()
        return {}, []  # reported with the state


def state(findings: Findings, path: Path) -> None:
    """A source's SQLite file, by its own check."""
    try:
        db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=30)
        try:
            result = [row[0] for row in db.execute("PRAGMA integrity_check(1)")]
        finally:
            db.close()
    except sqlite3.Error as error:
        result = [str(error)]
    findings.advance(path.stat().st_size)
    if not path.stat().st_size:
        result = ["it is empty"]  # to SQLite, a database without tables
    what = "" if result == ["ok"] else f"can't be read: {result[0]}"
    findings.checked("state", path, what, REBUILT)


def captured_kind(path: Path) -> str:
    """Whether a file lies among images or captured pages."""
    return "images" if path.parent.name == "images" else "captures"


def side_file(findings: Findings, path: Path) -> None:
    """A captured page's file or an image, by what it should be."""
    kind = captured_kind(path)
    if sidefiles.is_intact(path, advance=findings.advance) and _unpacks(path):
        findings.intact(kind, path)
    else:
        what = "is not what was stored" if path.stat().st_size else "is empty"
        findings.damaged(kind, path, what, _refetch_hint())


def lost_side_files(findings: Findings, root: Path) -> None:
    """Add missing pages and images that raw answers refer to."""
    pages, images = _named(root)
    for folder in pages.values():
        names = sidefiles.sums(root / folder) or dict.fromkeys(sidefiles.CAPTURE)
        for name in sorted(names):
            if not (root / folder / name).is_file():
                findings.missing("captures", root / folder / name, _refetch_hint())
        for sprite in _sprites(root / folder):
            images.add(str(BELOW.images / f"{sprite}.png"))
    for path in sorted(images):
        if not (root / path).is_file():
            findings.missing("images", root / path, _refetch_hint())


def _refetch_hint() -> str:
    return f"run `kb verify --repair`, then `kb {CAPTURED} crawl` and `kb {CAPTURED} filter`"


def _named(root: Path) -> tuple[dict[str, str], set[str]]:
    """The folder of each page's newest capture, and the paths of stored images."""
    pages: dict[str, str] = {}
    images: dict[str, str] = {}
    for answer in _answers(root, "renders"):
        if answer.get("outcome") == "captured" and _inside(answer.get("folder"), "pages"):
            pages[str(answer.get("page_id"))] = answer["folder"]
    for answer in _answers(root, "files"):
        if _inside(answer.get("path"), "images"):
            images[str(answer.get("key"))] = answer["path"]
    return pages, set(images.values())


def _answers(root: Path, kind: str) -> Iterator[dict[str, Any]]:
    for path in rawlog.segments(root, CAPTURED, kind):
        for _, line in rawlog.Frames(path, skip_damage=True, checked=True):
            yield rawlog.decode(line).response


def _inside(path: object, folder: str) -> bool:
    if not isinstance(path, str) or ".." in path:
        return False
    return Path(path).is_relative_to(BELOW.raw(CAPTURED, folder))


def _sprites(folder: Path) -> list[str]:
    try:
        packed = read_regular(folder / "extraction.json.zst")
        text = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        return sorted(msgspec.json.decode(text, type=_Extraction).sprites.values())
    except (OSError, zstandard.ZstdError, msgspec.DecodeError):
        return []  # reported with the captures


def _unpacks(path: Path) -> bool:
    """Whether a packed file can be unpacked: all that tells, where the list of digests is lost."""
    if path.suffix != ".zst":
        return True
    try:
        engine = zstandard.ZstdDecompressor().decompressobj()
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                engine.decompress(chunk)
    except zstandard.ZstdError:
        return False
    return bool(engine.eof)
