"""Which tables a folder holds: a data root, what `kb restore` left, or a downloaded release.

    clean.youtube_videos   rows that a filter kept; rejected, failed and pending beside them
    release.wiki_pages     rows of a release folder: a data root's own, or a download
    restored.reddit_posts  what `kb restore` or a reconstruction brought back
    links.entities         `kb links`' own tables, else those of a release

A download is one release folder, or a folder above several; checksums make a folder a release,
whatever else lies in it. Commands that only read take it as `--data` like a data root; what they
make of it goes to `workplace`, never into it. Looks at file names and checksums only.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kb.artifacts import manifest, release_folder
from kb.artifacts.data_roots import download_around, folders_in, is_root, require_known_format
from kb.artifacts.release_folder import ReleaseFolder
from kb.core.cached_property import cached_property
from kb.core.errors import FatalError, KbError, SettingError, UsageError
from kb.core.installation import cache_root
from kb.core.sources import PUBLISHED, SOURCES
from kb.core.suggestions import similar
from kb.schema.tables import Table, table, tables, tables_of
from kb.store.layout import TOP, VERDICTS, Layout, parquet_files, rows_pattern
from kb.store.tables import parquet

if TYPE_CHECKING:
    from kb.artifacts.remote_table import RemoteTable
    from kb.store.tables.remote_files import RemoteFolder

SCHEMAS = ("clean", "release", "restored", "links")  # a bare name is the first of these that has it
CONTENT = ("clean", "restored", "release")  # where a source's texts are read: the fullest first
_SHARD = re.compile(r"([a-z][a-z0-9_]*?)(?:-[0-9]+(?:-of-[0-9]+)?)?\.parquet")
NO_TABLES = "run a crawl and its filter first, or `kb demo`"


class View(NamedTuple):
    """A table that has files; `schema` is one of SCHEMAS, `doc` the table's one line. `home` is
    the folder that paths in its rows start from: a data root or a release folder. A table that is
    read at an address has no files here but is `remote`.
    """

    schema: str
    name: str
    files: list[Path]
    doc: str
    home: Path | RemoteFolder = Path()
    remote: RemoteTable | None = None

    @property
    def full(self) -> str:
        """ "clean.youtube_videos"."""
        return f"{self.schema}.{self.name}"

    @property
    def lists_tombstones(self) -> bool:
        """Whether the rows are removed keys, which `read_tombstones` reads from a file."""
        return bool(self.files) and self.files[0].stem == "tombstones"

    def verify_files(self, advance: Callable[[int], None] | None = None) -> None:
        """Raises DamagedData for bytes, columns or numbers that are not what they should be. Call
        it before rows are read. `advance` is called with the number of bytes read.
        """
        if self.remote is not None:
            self.remote.verify_footers()
        parquet.verify_files(*self.files, advance=advance)


@dataclass(frozen=True)
class Catalog:
    """What a folder holds. `path` is absolute."""

    path: Path

    @cached_property
    def is_download(self) -> bool:
        """Whether this is a release, or a reconstruction's `--out`, and not a data root: nothing
        may be written into it.
        """
        if is_root(self.path):
            return False
        return bool(self.releases) or (self.path / "missing.parquet").is_file()

    @property
    def spill(self) -> Path | None:
        """Where queries of it spill what memory does not hold; None for the temporary folder."""
        return None if self.is_download else self.path

    @property
    def is_writable(self) -> bool:
        """Whether what is made of this can be kept in it."""
        return not self.is_download and os.access(self.path, os.W_OK)

    @cached_property
    def releases(self) -> tuple[ReleaseFolder, ...]:
        """The release folder itself, or those below; of a data root those of `kb release`, else
        downloads that lie in it.
        """
        if not is_root(self.path) and (single := release_folder.recognise(self.path)):
            return (single,)
        own = tuple(release_folder.releases_below(Layout(self.path).release()))
        left_out = TOP if is_root(self.path) else ("release",)
        releases = (
            release
            for release in release_folder.releases_below(self.path)
            if release.path.name not in left_out
        )
        return own or tuple(releases)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """Every table, in a fixed order. Raises UsageError where two releases hold the same."""
        views = [*_clean(self.path), *_released(self.releases), *_restored(self.path)]
        views += _links(self.path, self.workplace, self.releases)
        return tuple(views)

    def require_tables(self) -> None:
        """Raises DamagedData for a table's file that should be there and is not."""
        for folder in self.releases:
            folder.require_tables()
        if is_root(self.path):
            for name in (*(f"clean/{source}" for source in SOURCES), "pairs", "films", "labels"):
                manifest.check_complete(self.path, name)

    @cached_property
    def workplace(self) -> Path:
        """The folder under which an index, a report or links of this are kept: the data root
        itself, or one of the user's cache for a download.
        """
        return self.cached if self.is_download else self.path

    @cached_property
    def cached(self) -> Path:
        """A folder of the user's cache for what is made of this and can't be kept in it."""
        mark = hashlib.sha256(os.fsencode(self.path.resolve())).hexdigest()[:16]
        return cache_root() / "downloads" / f"{self.path.name or 'root'}-{mark}"

    def schema_of(self, source: str) -> str:
        """Where the source's content is read from: one of CONTENT, "" where it has none.

        Raises DamagedData for lost clean files: they are never taken for none.
        """
        if source not in self._schemas:
            self._schemas[source] = self._find_schema(source)
        return self._schemas[source]

    @cached_property
    def _schemas(self) -> dict[str, str]:
        """What `schema_of` has answered: it is asked for each table of a source."""
        return {}

    def _find_schema(self, source: str) -> str:
        shorts = [*SOURCES[source].tables] if source in SOURCES else _main_tables(source)
        names = {(view.schema, view.name) for view in self.views}
        for schema in CONTENT:
            for short in shorts:
                declared = table(f"{source}/{short}")
                if schema == "clean" and not self.is_download:
                    manifest.check_complete(self.path, declared.name)
                if (schema, view_name(declared)) in names:
                    return schema
        return ""

    def texts(self, name: str) -> list[Path]:
        """The same as `files`, without tables of sources whose release holds no texts."""
        source = name.partition("/")[0]
        if self.schema_of(source) == "release" and not any(
            column.content and column.released
            for declared in tables_of(source)
            for column in declared.columns
        ):
            return []
        return self.files(name)

    def files(self, name: str) -> list[Path]:
        """The files of a declared table ("wiki/elements", "youtube/rejected") where its source's
        content is read from, in order. Raises DamagedData for a missing one.
        """
        source, _, short = name.partition("/")
        if source == "links":
            wanted = f"links.{short}"
        elif short in VERDICTS:
            wanted = f"clean.{source}_{short}"
        elif schema := self.schema_of(source):
            wanted = f"{schema}.{view_name(table(name))}"
        else:
            return []
        for view in self.views:
            if view.full == wanted:
                manifest.check_folder(view.files[0].parent)
                return view.files
        if wanted.partition(".")[0] in ("clean", "links"):
            manifest.check_complete(self.workplace, name)  # every file of it may be lost
        return []


def read_catalog(path: Path) -> Catalog:
    """What a folder holds. Raises SettingError for a folder that does not exist, FatalError for one
    without tables, DamagedData for a table's file that is missing.
    """
    there = existing(path)
    catalog = Catalog(there)
    catalog.require_tables()
    if not catalog.views:
        raise empty(there)
    return catalog


def outside(root: Path, out: Path) -> Path:
    """An `--out` as an absolute path. Raises UsageError for one inside of what is only read, or in
    a download.
    """
    place = out.expanduser().absolute()
    if place.resolve().is_relative_to(root.resolve()):
        raise UsageError(
            f"--out {out} is inside {root}, which this command only reads",
            hint="name a folder elsewhere with --out",
        )
    refuse_download(place, "--out")
    return place


def refuse_download(place: Path, option: str = "--data", *, named: bool = True) -> None:
    """Raises UsageError where a place, which need not exist, is a download or lies in one.

    `option` is the one that names it, `named` whether it was given.
    """
    place = Path(os.path.realpath(place.expanduser()))
    hint = f"a download stays as it is; name another place with {option}"
    catalog = Catalog(place)
    # A reconstruction goes on in its own --out, but is no data root.
    if catalog.is_download and (catalog.releases or option == "--data"):
        raise UsageError(f"{place} is a download", hint=hint)
    if (around := download_around(place, named=named)) is not None:
        raise UsageError(f"{place} is inside the download {around}", hint=hint)


def existing(path: Path) -> Path:
    """The folder as an absolute path; of the folder `restored/` in a data root, that data root.

    Raises SettingError, which names the nearest data root, NewerVersion.
    """
    path = path.expanduser().absolute()
    if not path.is_dir():
        raise empty(path)
    require_known_format(path)
    of_root = path == Layout(path.parent).restored() and not is_root(path)
    if of_root and any((path / name).is_dir() for name in PUBLISHED):
        return path.parent
    return path


def empty(path: Path) -> KbError:
    """What to say of a folder that does not exist (exit 2) or holds no tables (exit 1): the --data
    that was probably meant, or what makes tables.
    """
    if path.exists() and not path.is_dir():
        return SettingError(
            f"{path} is not a folder", hint="give a data root or a release folder as --data"
        )
    near = None if is_root(path) else nearest(path)
    if path.is_dir() and near is not None:
        return SettingError(f"{path} is not a data root or a release", hint=_meant(near))
    if path.is_dir():
        return FatalError(f"no tables in {path} yet, and it is not a release", hint=NO_TABLES)
    return SettingError(
        f"there is no data root {path}",
        hint=_meant(near) if near else f"check --data and KB_DATA, or {NO_TABLES}",
    )


def nearest(path: Path) -> Path | None:
    """The data root or download that was probably meant: in the folder or above it; for one that
    does not exist, the folder beside it with the most similar name.
    """
    if path.is_dir():
        below = folders_in(path)
        below += [inner for folder in below for inner in folders_in(folder)]
        inside, above = filter(_holds_something, below), filter(is_root, path.parents[:2])
        return next(inside, None) or next(above, None)
    siblings = {folder.name: folder for folder in folders_in(path.parent)}
    alike = (siblings[name] for name in similar(path.name, siblings))
    return next(filter(_holds_something, alike), None)


def _holds_something(path: Path) -> bool:
    try:
        return is_root(path) or bool(Catalog(path).views)
    except (KbError, OSError):  # nobody named this folder
        return False


def _meant(path: Path) -> str:
    here = os.path.relpath(path)
    return f"did you mean --data {shlex.quote(str(path) if here.startswith('..') else here)}?"


def bare(views: Iterable[View]) -> dict[str, View]:
    """What a name without a schema stands for."""
    ranked = sorted(views, key=lambda view: SCHEMAS.index(view.schema), reverse=True)
    return {view.name: view for view in ranked}


def _main_tables(name: str) -> list[str]:
    """Of what is made of sources: the table with its name, else all of its tables."""
    own = [declared.short for declared in tables_of(name)]
    return [name] if name in own else own


def view_name(declared: Table) -> str:
    """The view's name of a declared table: "youtube_videos", "pairs_quality"; "pairs", "entities",
    "links", "shots" and "film_figures" bear their own names.
    """
    source = declared.source.replace("-", "_")
    own = declared.short == source or declared.name == "links/entities" or source == "films"
    return declared.short if own else f"{source}_{declared.short}"


def tombstones_view(source: str) -> str:
    """The view's name of a source's removed keys: "youtube_tombstones"."""
    return f"{source.replace('-', '_')}_tombstones"


def _clean(root: Path) -> Iterator[View]:
    """Kept rows, what was rejected, failed or waits, and what was purged."""
    if not is_root(root):
        return
    at = Layout(root)
    for declared in tables().values():
        if declared.source in (*PUBLISHED, "films", "labels") and declared.source != "links":
            name, place = view_name(declared), at.table(declared.name)
            pattern = rows_pattern(declared.name)
            yield from _view("clean", name, place, pattern, declared.doc, root, links=True)
    for source in PUBLISHED:
        for verdict in VERDICTS:
            place, doc = at.clean(source, verdict), table(f"shared/{verdict}").doc
            name = f"{source}_{verdict}"
            yield from _view("clean", name, place, "*.parquet", doc, root, links=True)
        doc = table("shared/tombstones").doc
        place, name = at.tombstones(source), tombstones_view(source)
        yield from _view("clean", name, place.parent, place.name, doc, root, links=True)


def _released(folders: Iterable[ReleaseFolder]) -> list[View]:
    views: dict[str, View] = {}
    for folder in folders:
        own = folder.name.removeprefix(folder.source).replace("-", "_")  # of a selection
        mine = [
            View(
                "release", view_name(part.table) + own, [*part.shards], part.table.doc, folder.path
            )
            for part in folder.parts
        ]
        if mine and folder.tombstones is not None:
            name, doc = tombstones_view(folder.name), table("shared/tombstones").doc
            mine.append(View("release", name, [folder.tombstones], doc, folder.path))
        for view in mine:
            check_once(views, view)
    return list(views.values())


def check_once(views: dict[str, View], view: View) -> None:
    """Add a view by its full name. Raises UsageError where another folder holds the same table."""
    other = views.setdefault(view.full, view)
    if (other.home, other.files) != (view.home, view.files):
        raise UsageError(
            f"{view.full} is in {other.home} and in {view.home}",
            hint="read them separately: give one of them as --data, or kb.load(…) for each",
        )


def _restored(root: Path) -> Iterator[View]:
    """What `kb restore` and a reconstruction brought back."""
    at, links = Layout(root), is_root(root)
    reconstructed = list(_reconstructed(root, links))
    listed = {view.name for view in reconstructed}
    for declared in tables().values():
        name, place = view_name(declared), at.restored(declared.source, declared.short)
        if declared.source in SOURCES and name not in listed:
            yield from _view("restored", name, place, "*.parquet", declared.doc, root, links)
    yield from reconstructed
    for name in ("pairs", "draw"):
        doc = table(f"{name}/{name}").doc
        yield from _view("restored", name, at.restored(name), "*.parquet", doc, root, links)
    doc = table("shared/missing").doc
    yield from _view("restored", "missing", at.restored(), "missing.parquet", doc, root, links)


def _reconstructed(root: Path, links: bool) -> Iterator[View]:
    """Posts and comments: restored, or of a reconstruction in its usual place, or `root` is its
    `--out` itself.
    """
    at = Layout(root)
    for place in (at.restored("reddit"), at.reconstructed, root):
        if not (place / "missing.parquet").is_file():
            continue
        for short in ("posts", "comments"):
            doc = table(f"reddit/{short}").doc
            name, rows = f"reddit_{short}", place / short
            yield from _view("restored", name, rows, "*.parquet", doc, root, links)
        doc = table("reddit/missing").doc
        yield from _view("restored", "reddit_missing", place, "missing.parquet", doc, root, links)
        return


def _links(root: Path, work: Path, releases: Iterable[ReleaseFolder]) -> Iterator[View]:
    """The tables of `kb links` or of a release: of a data root its own first, of a download the
    released ones, which were made of more.
    """
    shards: dict[str, list[Path]] = {}
    made = [(parquet_files(Layout(work).links), root)] if is_root(root) or work != root else []
    released = [(release.data, release.path) for release in releases]
    for paths, home in [*made, *released] if is_root(root) else [*released, *made]:
        for path in paths:
            named = _SHARD.fullmatch(path.name)
            if named and f"links/{named[1]}" in tables():
                shards.setdefault(named[1], []).append(path)
        if shards:
            for name, files in shards.items():
                yield View("links", name, files, table(f"links/{name}").doc, home)
            return


def _view(
    schema: str, name: str, folder: Path, pattern: str, doc: str, home: Path, links: bool
) -> Iterator[View]:
    files = parquet_files(folder, pattern)
    if not links:  # no checksums describe what links in a stranger's folder lead to
        files = [path for path in files if not path.is_symlink()]
    if files:
        yield View(schema, name, files, doc, home)
