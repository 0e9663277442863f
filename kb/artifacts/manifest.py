"""The manifest of an artifact: what made it, from what, and which files with which content it has.

    clean/wiki/_manifest.json               in the artifact's folder, written last
    state/manifests/release-wiki.json       of public folders, which are given away as they are

A command that makes an artifact (kb.store.artifact_registry) writes it with `replacing`:

    inputs, settings = manifest.inputs(root, "pairs"), freshness.settings(run, "pairs")
    with manifest.replacing(root, "pairs", inputs=inputs, settings=settings) as build:
        ...                                  # write files below build.folder
        build.figures = {"videos": 207}      # what the command reports and others read

The folder then takes the old one's place in one step. Whoever reads it asks `read` for the figures,
`rows` for the files of a table, `verify` whether the bytes are those that were written; whether an
artifact is current says kb.artifacts.freshness. A command that changes files in place does so
within `editing`.
"""

import contextlib
import hashlib
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from kb.core.sources import SOURCES
from kb.store import damage
from kb.store.artifact_registry import ARTIFACTS, MANIFEST, SUMS, artifact_of, of_table
from kb.store.atomic import replacing_folder, write_bytes
from kb.store.damage import noted_damage, read_note
from kb.store.layout import Layout, parquet_files, rows_pattern
from kb.store.rawlog import rawlog
from kb.store.rawlog.raw_files import raw_files
from kb.store.tables import checksums, parquet
from kb.store.tables.checksums import FileEntry
from kb.store.tables.parquet import content_digest
from kb.store.walk import files_below
from kb.version import __version__

_SHARD = re.compile(r"(.+)-(\d{5})-of-(\d{5})(\.[a-z]+)")
_ABSENT = 1_000  # of the names of shards that are not there
_THREADS = 4  # files that are hashed at a time


class Manifest(msgspec.Struct, frozen=True, omit_defaults=True):
    """What an artifact was made of and what it consists of; `files` by path within its folder.

    `inputs` are digests by the name of the input; `settings` the values that decide its content,
    by their key in the profile, or by the name of a keyword file; `rules` is the number of its
    rules (kb.artifacts.freshness compares them).
    """

    artifact: str
    command: str = ""
    version: str = ""
    inputs: dict[str, str] = {}
    settings: dict[str, Any] = {}
    rules: int = 0
    files: dict[str, FileEntry] = {}
    figures: dict[str, Any] = {}


@dataclass
class Build:
    """An artifact that is being made; the caller writes below `folder` and may set the rest."""

    folder: Path
    inputs: dict[str, str]
    settings: dict[str, Any]
    figures: dict[str, Any] = field(default_factory=dict)


def read_manifest(root: Path, name: str) -> Manifest | None:
    """The manifest of an artifact; None where it was never made. Raises DamagedData."""
    artifact = ARTIFACTS[name]
    return read_note(artifact.manifest(root), Manifest, fix=artifact.hint)


@contextlib.contextmanager
def replacing(
    root: Path, name: str, *, inputs: Mapping[str, str], settings: Mapping[str, Any] | None = None
) -> Iterator[Build]:
    """A fresh folder that takes the artifact's place, with its manifest, when the block ends well.

    Call it under the artifact's lock. Raises DiskFull.
    """
    artifact = ARTIFACTS[name]
    with replacing_folder(artifact.folder(root)) as fresh:
        build = Build(fresh, dict(inputs), dict(settings or {}))
        yield build
        made = describe(name, fresh, build)
        if not artifact.public:
            write_manifest(fresh / MANIFEST, made)
        else:  # until the folder is in its place, nothing is promised about its files
            unknown = {file: FileEntry() for file in made.files}
            write_manifest(
                ARTIFACTS[name].manifest(root),
                msgspec.structs.replace(made, inputs={}, files=unknown),
            )
    if artifact.public:
        write_manifest(ARTIFACTS[name].manifest(root), made)


def record(folder: Path, name: str) -> None:
    """Write the manifest of a folder of Parquet files as it is now; of one that grows in place,
    such as scores. What else lies there is nobody's promise.

    Remove the manifest before the files change. Raises DiskFull.
    """
    write_manifest(
        folder / MANIFEST, describe(name, folder, Build(folder, {}, {}), parquet_files(folder))
    )


def describe(
    name: str, folder: Path, build: Build, present: Sequence[Path] | None = None
) -> Manifest:
    """The manifest of what lies in a folder, or of these files of it."""
    present = _files(folder) if present is None else present
    files = {str(path.relative_to(folder)): path for path in present}
    with ThreadPoolExecutor(_THREADS) as pool:
        entries = dict(zip(files, pool.map(entry_of, files.values()), strict=True))
    return new_manifest(name, build.inputs, build.settings, entries, build.figures)


def new_manifest(
    name: str,
    inputs: dict[str, str],
    settings: dict[str, Any],
    files: dict[str, FileEntry],
    figures: dict[str, Any] | None = None,
) -> Manifest:
    """The manifest of an artifact that is made now."""
    artifact, made_by = ARTIFACTS[name], __version__
    return Manifest(
        name, artifact.command, made_by, inputs, settings, artifact.rules, files, figures or {}
    )


def write_manifest(place: Path, manifest: Manifest) -> None:
    """Write a manifest. Raises DiskFull."""
    write_bytes(place, msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n")


def without_files(manifest: Manifest) -> Manifest:
    """What is left to say of an artifact that was removed: how it was made."""
    return msgspec.structs.replace(manifest, inputs={}, files={})


def write_vacant(root: Path, manifest: Manifest) -> None:
    """Write the manifest of an artifact that was removed and is to be made again; of its files it
    lists those that were kept. Raises DiskFull.
    """
    artifact = ARTIFACTS[manifest.artifact]
    folder = artifact.folder(root)
    files = {} if artifact.public else {file.name: entry_of(file) for file in _files(folder)}
    write_manifest(
        artifact.manifest(root), msgspec.structs.replace(manifest, inputs={}, files=files)
    )


def vacant(root: Path) -> list[str]:
    """The derived artifacts that were removed and are to be made again. Raises DamagedData."""
    return [
        name
        for name, artifact in ARTIFACTS.items()
        if artifact.maker and (made := read_manifest(root, name)) is not None and is_vacant(made)
    ]


def is_vacant(made: Manifest) -> bool:
    """Whether a derived artifact was removed and is to be made again."""
    return not made.inputs and made.files.keys() <= set(ARTIFACTS[made.artifact].kept_files)


def entry_of(file: Path) -> FileEntry:
    """A file as it is now."""
    rows = parquet.footer(file).num_rows if file.suffix == ".parquet" else None
    return FileEntry(file.stat().st_size, checksums.digest(file), rows)


@contextlib.contextmanager
def editing(root: Path, *names: str) -> Iterator[None]:
    """Change, add or remove files of artifacts in place, as a purge does; the manifests then say
    what they are.

    Cut off, they promise nothing about the content of any file, and the next `editing` reads all of
    them. Call it under the artifacts' locks.
    """
    before = {
        name: (read_manifest(root, name), _stamps(ARTIFACTS[name].folder(root))) for name in names
    }
    for manifest, _ in before.values():
        if manifest is not None:
            _write_entries(root, manifest, dict.fromkeys(manifest.files, FileEntry()))
    yield
    for name, (manifest, stamps) in before.items():
        if manifest is None:
            continue
        folder = ARTIFACTS[name].folder(root)
        now = _stamps(folder)
        entries = {}
        for file, entry in manifest.files.items():
            if file in now and (not entry.sha256 or stamps.get(file) != now[file]):
                entries[file] = entry_of(folder / file)
            elif file in now or file not in stamps:  # what was lost before stays known as missing
                entries[file] = entry
        for file in now.keys() - manifest.files.keys():
            if stamps.get(file) != now[file]:
                entries[file] = entry_of(folder / file)
        _write_entries(root, manifest, entries)


def _write_entries(root: Path, manifest: Manifest, files: dict[str, FileEntry]) -> None:
    write_manifest(
        ARTIFACTS[manifest.artifact].manifest(root), msgspec.structs.replace(manifest, files=files)
    )


def _stamps(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Inode, size and time of change of each file in a folder."""
    files = {str(path.relative_to(folder)): path.stat() for path in _files(folder)}
    return {name: (it.st_ino, it.st_size, it.st_mtime_ns) for name, it in files.items()}


def rows(root: Path, table: str) -> list[Path]:
    """The files of a declared table's rows ("youtube/videos"), in order; [] where nothing was made
    yet. Raises DamagedData where one of them is missing.
    """
    check_complete(root, table)
    return Layout(root).rows(table)


def check_complete(root: Path, name: str) -> None:
    """Raises DamagedData for the first missing file of an artifact, or of a declared table."""
    artifact = ARTIFACTS[name] if name in ARTIFACTS else of_table(name)
    if lost := missing(root, name):
        raise damage.missing(lost, artifact.hint)


def check_folder(folder: Path) -> None:
    """Raises DamagedData for the first missing file of a folder of Parquet files, which may be one
    of a data root, a release folder or any other with numbered shards.
    """
    match = artifact_of(folder)
    lost = [folder / shard for shard in siblings(path.name for path in parquet_files(folder))]
    lost = [path for path in lost if not path.exists()]
    if match is not None:
        root, artifact = match
        lost += [path for path in missing(root, artifact.name) if path.parent == folder]
    if lost:
        raise damage.missing(sorted(lost))


def missing(root: Path, name: str) -> list[Path]:
    """Files of an artifact, or of one declared table in it, that were written and are not there."""
    is_artifact = name in ARTIFACTS
    artifact = ARTIFACTS[name] if is_artifact else of_table(name)
    folder, manifest = artifact.folder(root), read_manifest(root, artifact.name)
    written = {folder / file for file in (manifest.files if manifest is not None else ())}
    at = Layout(root)
    if not artifact.public:
        for table in artifact.tables if is_artifact else (name,):
            there = at.rows(table)
            written |= {path.with_name(shard) for path in there for shard in siblings([path.name])}
    if not is_artifact:
        pattern = str(at.table(name) / rows_pattern(name))
        written = {path for path in written if path.match(pattern)}
    return sorted(path for path in written if not path.is_file())


def damaged(root: Path, name: str) -> list[str]:
    """What is wrong with the files of an artifact, by their names and sizes and by what commands
    have noted. Raises DamagedData for its manifest.
    """
    folder, manifest = ARTIFACTS[name].folder(root), read_manifest(root, name)
    what = dict.fromkeys(missing(root, name), "is missing")
    for file, entry in manifest.files.items() if manifest is not None else ():
        path = folder / file
        if path not in what and entry.sha256 and path.stat().st_size != entry.size:
            what[path] = "is damaged"
    for path in noted_damage(root, folder):
        what.setdefault(path, "is damaged")
    return [f"{path.name} {why}" for path, why in what.items()]


def siblings(names: Iterable[str]) -> set[str]:
    """The names of all shards of the tables that these shards belong to; where many are not there,
    the first thousand of them.
    """
    tables = Counter((m[1], m[3], m[4]) for name in names if (m := _SHARD.fullmatch(name)))
    return {
        f"{stem}-{number:05d}-of-{count}{ending}"
        for (stem, count, ending), there in tables.items()
        for number in range(min(int(count), there + _ABSENT))
    } | {name for name in names if _SHARD.fullmatch(name)}


def inputs(
    root: Path, name: str, files: Callable[[str], list[Path]] | None = None
) -> dict[str, str]:
    """The digests of an artifact's inputs as they are now. `files` finds the files of a table, when
    they are not those of the data root. Raises DamagedData for a lost file.
    """
    return {source: input_digest(root, name, source, files) for source in ARTIFACTS[name].inputs}


def input_digest(
    root: Path, name: str, of: str, files: Callable[[str], list[Path]] | None = None
) -> str:
    """The digest of one input (`of`) of an artifact as it is now. Raises DamagedData."""
    folder, _, raw = of.partition("/")
    if folder == "raw":
        # Names and sizes: segments only grow, and each other file is named by its content.
        source, _, kind = raw.partition("/")
        top, samples = Layout(root).raw(source, kind), SOURCES[source].unfiltered
        return _digest(
            f"{os.path.relpath(file, top).removesuffix(rawlog.OPEN.removeprefix(rawlog.SUFFIX))}"
            f" {file.stat().st_size}"
            for file in raw_files(root, source, kind)
            if file.name != SUMS and file.parent.name not in samples
        )
    artifact, find = ARTIFACTS[name], files or partial(rows, root)
    if artifact.every_file and (made := read_manifest(root, of)) is not None:
        return digest_of_files(made)
    wanted = [
        table for table in ARTIFACTS[of].tables if table in artifact.reads or not artifact.reads
    ]
    paths = {
        f"{table.partition('/')[2]}/{file.name}": file for table in wanted for file in find(table)
    }
    return _digest(f"{name} {content_digest(file)}" for name, file in paths.items())


def digest_of_files(made: Manifest) -> str:
    """A digest of all files of an artifact."""
    return _digest(f"{name} {entry.sha256}" for name, entry in made.files.items())


def _digest(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def _files(folder: Path) -> list[Path]:
    """Every file of an artifact but its manifest; hidden ones are on their way."""
    return [
        path
        for path in sorted(files_below(folder, strict=False))
        if path.name != MANIFEST and not path.name.startswith(".")
    ]
