"""Every file of a data root, by what it is; or of a release folder, or of a folder of releases."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import duckdb

from kb.core.errors import DamagedData, UsageError
from kb.core.progress import Progress
from kb.core.sources import PUBLISHED, SORTED
from kb.store import complete, database, indexed, leftovers, rawlog, sidefiles
from kb.store.advice import SOURCES, advice
from kb.store.layout import Layout, parquet_files
from kb.store.reading import scan
from kb.store.tally import VERDICTS
from kb.verify import raw, releases, tables
from kb.verify.busy import Busy
from kb.verify.found import Look

# Beside the folders of commands: other roots and what belongs to a checkout.
_NEIGHBOURS = {"demo", "dumps", "profiles", "demo-finished", ".gitignore", ".gitkeep"}
_KEYS = {"videos": "video_id", "pages": "page_id", "posts": "post_id", "comments": "comment_id"}
_DOWNLOAD = "download it again, into the same folder"
_CLEARED = "a killed command left it: `kb verify --repair` or the next command there clears it"


def verify(folder: Path, progress: Progress) -> Look:
    """Read every byte of a data root, a release folder or a folder of releases.

    Changes nothing and takes no lock: what other processes write to meanwhile is looked at once
    more, and what is on its way there is not told. Memory is bounded by a piece of a file and the
    names of files. Raises UsageError for a folder that is none of these.
    """
    folder = folder.absolute()
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}", hint="check --data or the folder's name")
    several = [one for one in sorted(folder.iterdir()) if one.is_dir() and releases.is_release(one)]
    of_root = is_root(folder)
    files = list(_files(folder))
    size = sum(map(_size, files))
    with progress.task(f"verify {folder.name}", total=size, unit="bytes") as task:
        read = 0

        def advance(n: int) -> None:
            nonlocal read
            read += n
            task.advance(n)

        look = Look(advance)
        if releases.is_release(folder) and not of_root:
            releases.folder(look, folder, lambda path: _DOWNLOAD, described=True)
        elif several and not of_root:
            for one in several:
                releases.folder(look, one, lambda path: _DOWNLOAD, described=True)
        elif of_root:
            busy = Busy(folder)
            _Root(look, folder).all(files)
            _look_again(look, folder, busy, progress)
        else:
            raise UsageError(
                f"{folder} is neither a data root nor a release",
                hint="give the folder with SHA256SUMS, one that holds such folders, or a data root",
            )
        task.advance(max(0, size - read))  # locks and lists
    return look


def _look_again(look: Look, root: Path, busy: Busy, progress: Progress) -> None:
    """Drop what was found only because another process was writing there."""
    doubtful = [one for one in look.found if busy.touches(one.path)]
    if not doubtful:
        return
    second = Look(look.advance)
    _Root(second, root).all([path for path in _files(root) if busy.touches(path)])
    again = {(one.kind, one.state, one.path) for one in second.found}
    held = {
        one
        for one in doubtful
        if (one.kind, one.state, one.path) not in again
        or (one.kind == "leftovers" and not busy.is_abandoned(one.path))
    }
    look.drop(held)
    for pid in sorted({pid for one in held for pid in busy.holders(one.path)}):
        progress.say(f"another process (pid {pid}) is writing: what is on its way is not told")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0  # replaced meanwhile


def is_root(folder: Path) -> bool:
    """Whether a folder is a data root; a folder of releases may have one named "pairs"."""
    return any((folder / name).is_dir() for name in ("raw", "state", "clean", "release"))


def _files(folder: Path) -> Iterator[Path]:
    """Every file below a folder, through links to folders too, each place once."""
    seen = set()
    for where, folders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(where)
        if real in seen:
            folders.clear()
            continue
        seen.add(real)
        if Path(where) == folder:
            folders[:] = [name for name in folders if name not in _NEIGHBOURS]
        folders.sort()
        yield from (Path(where, name) for name in sorted(names))


class _Root:
    def __init__(self, look: Look, root: Path) -> None:
        self._look, self._root, self._at = look, root, Layout(root)
        self._segments = {source: raw.Segments(look, root, source) for source in SOURCES}

    def all(self, files: list[Path]) -> None:
        """Each file by where it is, then what is not there, then what the files say together."""
        for path in files:
            try:
                self._file(path, path.relative_to(self._root).parts)
            except FileNotFoundError:
                continue  # replaced meanwhile; what is gone for good is told below
        for segments in self._segments.values():
            segments.end()
        steadily = self._look.steadily
        steadily(lambda: raw.lost_side_files(self._look, self._root))
        steadily(self._tables)
        steadily(self._indexes)
        for source in PUBLISHED:
            steadily(partial(self._release, source))
        self._foreign_releases()

    def _file(self, path: Path, parts: tuple[str, ...]) -> None:
        look = self._look
        if path.is_symlink() and not path.exists():
            look.foreign("other", path, "is a link that leads nowhere", "remove it")
        elif leftovers.is_left(parts):
            look.foreign("leftovers", path, "is on its way, or was left", _CLEARED)
        elif len(parts) == 1:
            if path.name not in _NEIGHBOURS:
                look.foreign("other", path, "no command has written it", "move it away")
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
                look.foreign("release", path, "a release is a folder", "move it away")
        else:
            look.advance(path.stat().st_size)
            look.foreign("other", path, "no command has written it", "move it away")

    def _raw(self, path: Path, parts: tuple[str, ...]) -> None:
        look, known = self._look, parts[1] in SOURCES
        if known and len(parts) == 3 and path.name.startswith("tombstones"):
            self._parquet("tombstones", path)
        elif known and len(parts) == 4 and path.name.endswith((rawlog.SUFFIX, rawlog.OPEN)):
            self._segments[parts[1]].file(path)
        elif known and len(parts) == 4 and f"{rawlog.SUFFIX}.damaged-" in path.name:
            look.advance(path.stat().st_size)
            look.whole("set aside", path)
        elif known and parts[1:3] in (("wiki", "pages"), ("wiki", "images")):
            if path.name.endswith(sidefiles.ASIDE):
                look.whole("set aside", path)
            else:
                raw.side_file(look, path)
        else:
            look.foreign("raw answers", path, "no crawl or import has written it", "move it away")

    def _state(self, path: Path, parts: tuple[str, ...]) -> None:
        look, name = self._look, path.name
        if name.endswith(".sqlite") and len(parts) == 2:
            raw.state(look, path)
        elif name == "tombstones.parquet":
            self._parquet("tombstones", path)
        elif name.endswith(".parquet"):
            self._parquet("state", path)
        elif name.endswith(".json"):
            look.advance(path.stat().st_size)
            what = _json(path)
            if what:
                look.damaged("state", path, what, "move it away, or put it back from a copy")
            else:
                look.whole("state", path)
        elif name.endswith(sidefiles.ASIDE):
            look.whole("set aside", path)
        elif _is_of_state(name):
            look.whole("state", path)
        else:
            look.foreign("state", path, "no command has written it", "move it away")

    def _made(self, path: Path, parts: tuple[str, ...]) -> None:
        kind = parts[0]
        if path.name.endswith(sidefiles.ASIDE):
            self._look.whole("set aside", path)
        elif path.suffix == ".parquet" and self._is_listed(path, parts):
            self._parquet(kind, path)
        elif path.suffix == ".json" and kind in ("clean", "pairs", "links"):
            self._look.advance(path.stat().st_size)
            what = _json(path)
            if what:
                self._look.damaged(kind, path, what, advice(path))
            else:
                self._look.whole(kind, path)
        else:
            self._look.foreign(kind, path, "no command has written it", "move it away")

    def _is_listed(self, path: Path, parts: tuple[str, ...]) -> bool:
        """Whether a filter says that it wrote a clean file; of other tables all are taken."""
        if parts[0] != "clean":
            return True
        try:
            listed = complete.listed(path.parent.parent)
        except DamagedData:
            return True  # told with the list
        return not listed or path.name in listed.get(path.parent.name, ())

    def _parquet(self, kind: str, path: Path) -> None:
        what = tables.problem(path, self._look.advance)
        if what:
            self._look.damaged(kind, path, what, advice(path))
        else:
            self._look.whole(kind, path)

    def _plain(self, path: Path, kind: str) -> None:
        """Files of other layouts and figures; there are no checksums of these."""
        if path.suffix == ".parquet":
            self._parquet(kind, path)
            return
        self._look.advance(path.stat().st_size)
        if path.stat().st_size or path.suffix not in (".json", ".jsonl", ".html", ".png", ".svg"):
            self._look.whole(kind, path)
        else:
            self._look.damaged(kind, path, "is empty", advice(path))

    def _index(self, path: Path, parts: tuple[str, ...]) -> None:
        """What `kb search` reads; it is made again at any time."""
        look = self._look
        if len(parts) != 3 or parts[1] not in SOURCES:
            look.foreign("index", path, indexed.FOREIGN, "move it away")
            return
        look.advance(path.stat().st_size)
        if path.name in indexed.LOCKS:
            return
        is_note = path == self._at.indexed(parts[1])
        what = _json(path) if is_note else indexed.problem(self._root, parts[1], path.name)
        if what == indexed.FOREIGN:
            look.foreign("index", path, what, "move it away")
        elif what:
            look.damaged("index", path, what, "run `kb index --again`")
        else:
            look.whole("index", path)

    def _indexes(self) -> None:
        """Files of indexes that were written and are not there."""
        for source in SOURCES:
            for path in indexed.missing(self._root, source):
                self._look.missing("index", path, "run `kb index --again`")

    def _tables(self) -> None:
        """Files that were written and are not there; keys that have two answers."""
        folders = [self._at.pairs, self._at.links]  # each with a note beside its tables
        with contextlib.suppress(DamagedData):  # told with the list
            folders += complete.tables(self._root)
        for folder in folders:
            kind = folder.relative_to(self._root).parts[0]
            try:
                gone = complete.missing(folder)
            except DamagedData:
                continue
            for path in gone:
                self._look.missing(kind, path, advice(path))
        for source in SOURCES:
            self._counts(source)

    def _counts(self, source: str) -> None:
        """crawled = kept + rejected + failed + pending: no key is in two of them."""
        clean = self._at.clean(source)
        if any(clean in one.path.parents for one in self._look.of("clean")):
            return  # counting makes sense of whole files only
        parts = [
            f"SELECT '{prefix}' || {_KEYS[short]}::VARCHAR AS key FROM {scan(files)}"
            for short, prefix in SORTED[source].items()
            if (files := parquet_files(clean / short))
        ]
        parts += [
            f"SELECT key FROM {scan(files)}"
            for verdict in VERDICTS
            if (files := parquet_files(clean / verdict))
        ]
        if not parts:
            return
        sql = f"SELECT count(*) - count(DISTINCT key) FROM ({' UNION ALL '.join(parts)})"
        try:
            with database.connect(self._root) as con:
                more = (con.execute(sql).fetchone() or (0,))[0]
        except duckdb.Error as error:
            self._look.damaged("clean", clean, str(error).splitlines()[0], advice(clean / "x"))
            return
        if more:
            what = f"{more:,} keys are in two of kept, rejected, failed and pending"
            self._look.damaged("clean", clean / "summary.json", what, advice(clean / "x"))

    def _release(self, source: str) -> None:
        folder = self._at.release(source)
        if folder.is_dir() and any(folder.iterdir()):
            releases.folder(self._look, folder, advice, described=False)
        elif complete.exported(self._root, source):
            self._look.missing("release", folder, advice(folder / "x"))

    def _foreign_releases(self) -> None:
        for other in sorted(self._at.release().glob("*/")):
            if other.name not in PUBLISHED and not leftovers.is_left((other.name,)):
                what = "no export has written it"
                self._look.foreign("release", other, what, "move it away")


def _json(path: Path) -> str:
    """What is wrong with a JSON file, "" when nothing is."""
    try:
        json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        return f"can't be read: {error}"
    return ""


def _is_of_state(name: str) -> bool:
    endings = (".lock", ".key", ".key.sha256", ".exported", ".sqlite-wal", ".sqlite-shm")
    return name.endswith((*endings, ".bak", ".txt")) or name == ".gitkeep"
