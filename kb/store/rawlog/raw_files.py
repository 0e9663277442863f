"""What the files below raw/<source>/ are, by their names; whoever goes through all of them asks.

    <kind>/000001-1f2e3d4c.ndjson.zst           answers, closed or open
    pages/…, images/…                           files that were captured beside them
    tombstones*                                 purged keys, and copies of them
    key-<digest>.sha256                         with which key names were hashed
    ….damaged-<offset>, <captured>.damaged      what was set aside, as it can't be read

Anything else was left by a killed command (kb.store.leftovers), or no command has written it.
"""

from collections.abc import Collection
from enum import Enum, auto
from pathlib import Path

from kb.core.sources import SOURCES
from kb.store.layout import BELOW, Layout
from kb.store.rawlog import rawlog, sidefiles
from kb.store.walk import files_below


class RawKind(Enum):
    """What a file below raw/<source>/ is."""

    SEGMENT = auto()
    CAPTURED = auto()
    TOMBSTONES = auto()
    KEY_MARK = auto()
    SET_ASIDE = auto()
    FOREIGN = auto()


KEPT = (RawKind.SEGMENT, RawKind.CAPTURED, RawKind.TOMBSTONES, RawKind.KEY_MARK)
"""What tables are made of: all but what was set aside, left or put there by somebody else."""


def raw_files(
    root: Path, source: str, kind: str = "", of: Collection[RawKind] = KEPT
) -> list[Path]:
    """A source's files, or those below raw/<source>/<kind>/, that are one of `of`, by path, through
    links to folders. Raises DamagedData for a link that leads back or nowhere (kb.store.walk).
    """
    top = Layout(root).raw(source)
    paths = (
        path
        for path in files_below(Layout(root).raw(source, kind), root)
        if kind_of(source, path.relative_to(top)) in of
    )
    return sorted(paths)


def kind_of(source: str, path: Path) -> RawKind:
    """What a file is, by its path below raw/<source>/."""
    folders, name = path.parts[:-1], path.name
    if source not in SOURCES or any(part.startswith(".") for part in path.parts):
        return RawKind.FOREIGN
    if not folders:
        if name.startswith("tombstones"):
            return RawKind.TOMBSTONES
        is_mark = path.match(BELOW.key_mark(source, "*").name)
        return RawKind.KEY_MARK if is_mark else RawKind.FOREIGN
    if len(folders) == 1 and name.endswith((rawlog.SUFFIX, rawlog.OPEN)):
        return RawKind.SEGMENT  # of the wiki's kind `pages` too, beside the captures
    if len(folders) == 1 and f"{rawlog.SUFFIX}.damaged-" in name:
        return RawKind.SET_ASIDE
    if folders[0] in SOURCES[source].files:
        if name.endswith(sidefiles.QUARANTINE_SUFFIX):
            return RawKind.SET_ASIDE
        return RawKind.CAPTURED if sidefiles.is_captured_name(name) else RawKind.FOREIGN
    return RawKind.FOREIGN
