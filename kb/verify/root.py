"""Verifies a data root, a release folder or a folder of releases.

After each file by itself come the checks across files: missing files, and keys with two verdicts.
Findings that another process caused by writing at the same time are dropped.
"""

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from kb.artifacts import manifest, release_folder
from kb.artifacts.data_roots import is_root
from kb.artifacts.table_catalog import Catalog, empty, existing
from kb.core.errors import DamagedData
from kb.core.progress import Progress
from kb.core.sources import PUBLISHED, SOURCES
from kb.schema.tables import table
from kb.store import leftovers, lock
from kb.store.artifact_registry import ARTIFACTS, SUMS, artifact_of, selections
from kb.store.damage import DOWNLOAD, remedy
from kb.store.layout import VERDICTS, Layout, parquet_files
from kb.store.state import tombstones
from kb.store.tables import checksums, database
from kb.store.tables.checksums import read_small, short_lines
from kb.store.tables.reading import reading, scan
from kb.store.walk import walk
from kb.verify import raw
from kb.verify.files import NEIGHBOURS, FileVerifier, irregular, problem
from kb.verify.findings import Findings

_CHECKS = 3
CROISSANT = "croissant.json"
# A release may be the checkout of a repository; the last is the file system's own.
_PLAIN = {".gitkeep", ".gitattributes", ".git", "lost+found"}


def check_release(
    findings: Findings, path: Path, advice: Callable[[Path], str], *, described: bool
) -> None:
    """Every file of a release folder; `described`: it should have SHA256SUMS."""
    sums = path / SUMS
    known, invalid = release_folder.sums(path)
    if what := irregular(sums):
        findings.damaged("release", sums, what, advice(sums))
    elif sums.is_file() and (not known or invalid):
        findings.damaged("release", sums, "is not a list of checksums", advice(sums))
    elif sums.is_file():
        findings.intact("release", sums)
    elif described:
        findings.missing("release", sums, advice(sums))
    there = {file.name: file for file in sorted(path.iterdir())}
    for name, file in there.items():
        if file == sums or name in _PLAIN:
            continue
        if name not in known and (file.is_symlink() or file.is_dir()):
            findings.foreign(
                "release", file, "a release is flat, with files of its own", "move it away"
            )
        elif known and name not in known:
            findings.foreign("release", file, f"is not in {SUMS}", "move it away")
        elif what := irregular(file):
            findings.damaged("release", file, what, advice(file))
        elif not file.exists():
            findings.missing("release", file, advice(file), "is a link that leads nowhere")
        else:
            _file(findings, file, known.get(name), advice(file))
    for name in sorted((known.keys() | manifest.siblings(there)) - there.keys()):
        findings.missing("release", path / name, advice(path / name))
    if known:
        _metadata(findings, path / CROISSANT, known, advice)


def _file(findings: Findings, path: Path, wanted: str | None, advice: str) -> None:
    if wanted is not None:
        actual = checksums.digest(path, advance=findings.advance)
        what = "" if actual == wanted else f"differs from {SUMS}"
    elif path.suffix == ".parquet":
        what = problem(path, findings.advance)
    elif path.suffix == ".tar":
        findings.advance(path.stat().st_size)
        what = _tar(path)
    else:
        findings.advance(path.stat().st_size)
        what = ""
    findings.checked("release", path, what, advice)


def _tar(path: Path) -> str:
    """What is wrong with a tar by the index beside it, "" when nothing is."""
    index = path.parent / release_folder.INDEX
    if not index.is_file():
        return ""
    left = path.stat().st_size  # the members lie side by side, so together they are no larger
    try:
        with path.open("rb") as tar:
            for line in short_lines(index):
                entry = json.loads(line)
                if entry["tar"] != path.name:
                    continue
                offset, size = int(entry["offset"]), int(entry["size"])
                left -= size
                if size < 0 or left < 0 or not _holds(tar, offset, size, entry["sha256"]):
                    return f"{entry['member']} in it is not what {release_folder.INDEX} says"
    except (DamagedData, ValueError, KeyError, TypeError, OverflowError, RecursionError, OSError):
        return f"{release_folder.INDEX} beside it can't be read"
    return ""


def _holds(tar: Any, offset: int, size: int, wanted: str) -> bool:
    computed = hashlib.sha256()
    tar.seek(offset)
    while size and (chunk := tar.read(min(size, 1 << 20))):
        computed.update(chunk)
        size -= len(chunk)
    return not size and computed.hexdigest() == wanted


def _metadata(
    findings: Findings, path: Path, known: dict[str, str], advice: Callable[[Path], str]
) -> None:
    """Croissant names files with their digests: the same as SHA256SUMS."""
    if not path.is_file():
        return
    try:
        digests = {
            file["contentUrl"].rpartition("/")[2]: file["sha256"]
            for file in json.loads(read_small(path))["distribution"]
            if "sha256" in file
        }
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, DamagedData):
        digests = None
    if digests is None:
        findings.damaged("release", path, "is not valid metadata", advice(path))
        return
    for name, value in sorted(digests.items()):
        if known.get(name, value) != value:
            what = f"has another digest of {name} than {SUMS}"
            findings.damaged("release", path, what, advice(path))


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


def compare(findings: Findings, root: Path) -> None:
    """Add what no file shows by itself: missing files, keys with two verdicts."""
    steps = [
        partial(raw.lost_side_files, findings, root),
        partial(_missing_files, findings, root),
        partial(_missing_tombstones, findings, root),
        *(partial(_two_answers, findings, root, source) for source in SOURCES),
        *(
            partial(_release, findings, root, name)
            for name in dict.fromkeys([*PUBLISHED, *selections(root)])
        ),
    ]
    for step in steps:
        findings.retrying(step)
    for other in sorted(Layout(root).release().glob("*/")):
        known = {*PUBLISHED, *_PLAIN, *selections(root)}
        if other.name not in known and not leftovers.is_left((other.name,)):
            findings.foreign("release", other, "no export has written it", "move it away")


def _missing_files(findings: Findings, root: Path) -> None:
    """Add missing files of artifacts; releases are checked by their own checksums."""
    for name, artifact in ARTIFACTS.items():
        kind = name.partition("/")[0]
        if artifact.public or kind == "restored":
            continue
        with contextlib.suppress(DamagedData):  # reported with the manifest itself
            lost = manifest.missing(root, name)
            is_made = manifest.read_manifest(root, name) is not None
            if kind == "index" and not is_made and any(artifact.folder(root).glob("*.store")):
                lost = [artifact.manifest(root)]
            for path in lost:
                findings.missing(kind, path, artifact.hint)


def _missing_tombstones(findings: Findings, root: Path) -> None:
    for source in SOURCES:
        path = tombstones.path(root, source)
        try:
            tombstones.keys(root, source)
        except DamagedData as error:
            if not any(finding.path in (path, *error.paths) for finding in findings.entries):
                findings.missing("tombstones", path, error.hint, str(error))


def _two_answers(findings: Findings, root: Path, source: str) -> None:
    """crawled = kept + rejected + failed + pending: no key is in two of them."""
    clean = Layout(root).clean(source)
    if any(clean in finding.path.parents for finding in findings.of_kinds("clean")):
        return  # counting makes sense of whole files only
    keys = [
        (
            f"'{prefix}' || {table(f'{source}/{short}').key[0]}::VARCHAR",
            parquet_files(clean / short),
        )
        for short, prefix in SOURCES[source].tables.items()
    ]
    keys += [("key", parquet_files(clean / verdict)) for verdict in VERDICTS]
    all_files = [file for _, files in keys for file in files]
    if not all_files:
        return
    try:
        parts = [f"SELECT {key} AS key FROM {scan(files)}" for key, files in keys if files]
        sql = f"SELECT count(*) - count(DISTINCT key) FROM ({' UNION ALL '.join(parts)})"
        with reading(all_files), database.over(all_files, root) as con:
            more = (con.execute(sql).fetchone() or (0,))[0]
    except DamagedData as error:
        findings.damaged("clean", clean, str(error).splitlines()[0], remedy(clean / "x"))
        return
    if more:
        what = f"{more:,} keys are in two of kept, rejected, failed and pending"
        findings.damaged("clean", clean / "summary.json", what, remedy(clean / "x"))


def _release(findings: Findings, root: Path, source: str) -> None:
    folder = Layout(root).release(source)
    if folder.is_dir() and any(folder.iterdir()):
        check_release(findings, folder, remedy, described=False)
    elif (made := manifest.read_manifest(root, f"release/{source}")) is not None and made.files:
        findings.missing("release", folder, remedy(folder / "x"))


def verify(folder: Path, progress: Progress) -> Findings:
    """Read every byte of a data root, a release folder or a folder of releases.

    Changes nothing and takes no lock: what other processes write to meanwhile is checked once more,
    and their unfinished files are not reported. Memory is bounded by a piece of a file and the
    names of files. Raises SettingError for a folder that does not exist, FatalError for one that is
    none of these.
    """
    folder = existing(folder)
    catalog = Catalog(folder)
    if not is_root(folder) and not catalog.releases:
        raise empty(folder)
    busy = Busy(folder)  # before the list: what was on its way in it may be finished at once
    if is_root(folder):
        files = list(_files(folder))
    else:  # a stranger's links are not followed
        files = [
            file for release in catalog.releases for file in release_folder.entries(release.path)
        ]
    size = sum(map(_size, files))
    with progress.task(f"verify {folder.name}", total=size, unit="bytes") as task:
        read = 0

        def advance(n: int) -> None:
            nonlocal read
            read += n
            task.advance(n)

        findings = Findings(advance)
        if is_root(folder):
            _root(findings, folder, files)
            _recheck(findings, folder, busy, progress)
        else:
            for release in catalog.releases:
                check_release(findings, release.path, lambda path: DOWNLOAD, described=True)
        task.advance(max(0, size - read))  # locks and lists
    return findings


def _root(findings: Findings, root: Path, files: Iterable[Path]) -> None:
    """Each file by where it is, then what is not there, then what the files say together."""
    FileVerifier(findings, root).verify_files(files)
    compare(findings, root)


def _recheck(findings: Findings, root: Path, busy: Busy, progress: Progress) -> None:
    """Drop findings that another process caused by writing at the same time."""
    doubtful = [finding for finding in findings.entries if busy.touches(finding.path)]
    if not doubtful:
        return
    second = Findings(findings.advance)
    _root(second, root, [path for path in _files(root) if busy.touches(path)])
    confirmed = {(finding.kind, finding.state, finding.path) for finding in second.entries}
    unconfirmed = {
        finding
        for finding in doubtful
        if (finding.kind, finding.state, finding.path) not in confirmed
        or (finding.kind == "leftovers" and not busy.is_abandoned(finding.path))
    }
    findings.drop(unconfirmed)
    for pid in sorted({pid for finding in unconfirmed for pid in busy.holders(finding.path)}):
        progress.say(f"another process (pid {pid}) is writing: its unfinished files are not listed")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except FileNotFoundError:
        return 0  # replaced meanwhile


def _files(folder: Path) -> Iterator[Path]:
    """Every file below a folder, and links that can't be followed."""
    for where, folders, others in walk(folder, strict=False):
        if where == folder:
            folders[:] = [name for name in folders if name not in NEIGHBOURS]
        yield from (Path(entry.path) for entry in others)
