"""`kb merge`: the data roots of several machines become one.

    raw            answers and files, each once; an open segment as far as it can be read
    tombstones     of all roots, the oldest of each key
    state          what each machine has spent; notes of imported dumps; the key of authors
    annotations    scores, each once
    labels         the newest answers of each person (kb.labels.imports)

What was set aside as damaged, what killed commands left and what no command has written stays.
Items and cursors are not copied: the next crawl reads the new segments into its state, as it does
with its own after it was killed. Everything else is made again from these. Each file appears
complete or not at all, so the same command resumes.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from kb.artifacts import domain_binding, purge, score_files
from kb.artifacts.data_roots import is_root
from kb.artifacts.table_catalog import existing
from kb.core.context import Run
from kb.core.errors import OtherService, SettingError, WriterLocked
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.store import lock
from kb.store.atomic import followed, write_bytes, writing
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout
from kb.store.rawlog import rawlog
from kb.store.rawlog.raw_files import RawKind, raw_files
from kb.store.state import tombstones
from kb.store.state.frontier import Frontier


def merge(run: Run, others: Sequence[Path]) -> Summary:
    """Bring these roots into the run's; the purges of sources that are to be finished then have a
    list (`Layout.purge`). Raises SettingError, OtherService and WriterLocked before
    anything is written; DiskFull.
    """
    roots = [existing(root).resolve() for root in others]
    for root in roots:
        if root == run.root.resolve() or roots.count(root) > 1:
            raise SettingError(f"{root} is named twice", hint="name each data root once")
        if not is_root(root):
            raise SettingError(f"{root} is not a data root", hint="name folders with raw/ in them")
        if pid := lock.another(root):
            raise WriterLocked(f"a process (pid {pid}) writes to {root}", hint="wait for its end")
    _check(run, roots)
    # Links that can't be followed are found before anything is written.
    files = {(root, source): _files(root, source) for root in roots for source in SOURCES}
    run.root.mkdir(parents=True, exist_ok=True)
    counts: Counter[str] = Counter()
    with domain_binding.writing(run, *SOURCES), full_disk_is_resumable(run.root):
        for source in SOURCES:
            for root in roots:
                tombstones.unite(run.root, source, root)
            purged, before = _begin_purge(run.root, source), counts["files"] + counts["scores"]
            for root in roots:
                there, name = files[root, source], f"merge {source} of {root}"
                with run.progress.task(name, total=len(there), unit="files") as task:
                    for path in there:
                        counts.update(_bring(path, root, run.root))
                        task.advance(1, copied=counts["files"])
                _note(root, run.root, source)
                counts["requests"] += _spent(root, run.root, source)
                counts["scores"] += score_files.bring(run.root, source, root)
            if purged and counts["files"] + counts["scores"] == before:  # nothing may hold it
                Layout(run.root).purge(source).unlink()
        domain_binding.note_if_stored(run.root, run.profile)
    return Summary(
        command="merge",
        folders=len(roots),
        files=counts["files"],
        present=counts["present"],
        bytes=counts["bytes"],
        requests=counts["requests"],
        scores=counts["scores"],
        path=str(run.root),
    )


def _begin_purge(root: Path, source: str) -> bool:
    """List what was purged on any machine as a purge that is not finished: what another machine
    brings may hold it. False where there is nothing, or such a list already.
    """
    keys = tombstones.tombstone_rows(root, source).select(["key", "reason"]).to_pylist()
    path = Layout(root).purge(source)
    if not keys or path.exists():
        return False
    purge.note_keys(root, source, {row["key"]: row["reason"] for row in keys})
    return True


def _check(run: Run, roots: Sequence[Path]) -> None:
    """Raises OtherService for a root of another profile, host, subreddit or key of authors."""
    hosts: dict[tuple[str, str], tuple[Path, str]] = {}
    keys: dict[tuple[str, str], Path] = {}
    for root in (run.root, *roots):
        domain_binding.require_domain(root, run.profile)
        for source in SOURCES:
            for name, value in domain_binding.bound_services(root, source).items():
                first, known = hosts.setdefault((source, name), (root, value))
                if known != value:
                    raise OtherService(
                        f"{root} holds {source} data of {name} {value}, and {first} of {known}",
                        hint="merge roots of the same services",
                    )
            for mark in Layout(root).key_marks(source):
                keys[source, mark.name] = root
            of_source = [(name, at) for (owner, name), at in keys.items() if owner == source]
            if len(of_source) > 1:
                raise OtherService(
                    f"the authors of {of_source[0][1]} and {of_source[1][1]} were hashed with two"
                    f" keys",
                    hint=f"copy {Layout(run.root).key(source).name} to each machine before its"
                    " first crawl, and collect again on all but one",
                )


def _files(root: Path, source: str) -> list[Path]:
    """What is brought over: captured files before the answers that name them; tombstones and scores
    are united by their rows.
    """
    captured = raw_files(root, source, of=(RawKind.CAPTURED, RawKind.KEY_MARK))
    notes = sorted(Layout(root).importing(source).glob("*.json"))
    return [*captured, *raw_files(root, source, of=(RawKind.SEGMENT,)), *notes]


def _bring(path: Path, root: Path, home: Path) -> dict[str, int]:
    """Copy a file unless it is there; what was done."""
    place = home / path.relative_to(root)
    size = path.stat().st_size
    if path.name.endswith(rawlog.OPEN):
        frames = rawlog.Frames(path, skip_damage=True)
        for _ in frames:
            pass
        size, place = frames.good, place.with_name(rawlog.base_name(path))
    if not size and path.suffix != ".sha256":
        return {"present": 1}
    there = next((path for path in (place, Path(f"{place}.open")) if path.exists()), None)
    if there is not None:
        known = there.stat().st_size
        common = min(known, size)
        if _digest(there, common) == _digest(path, common):
            if known >= size:
                return {"present": 1}
        elif rawlog.SUFFIX not in place.name:
            return {"present": 1}  # captured again, or a note of the same dump: the first stays
        else:
            stem = place.name.removesuffix(rawlog.SUFFIX)
            there = place.with_name(f"{stem}-{_digest(path, size)[:8]}{rawlog.SUFFIX}")
            place = there
            if place.exists():
                return {"present": 1}
        place = there
    place.parent.mkdir(parents=True, exist_ok=True)
    with writing(followed(place)) as temporary, path.open("rb") as old, temporary.open("wb") as new:
        left = size
        while left and (data := old.read(min(left, 1 << 20))):
            new.write(data)
            left -= len(data)
    return {"files": 1, "bytes": size}


def _digest(path: Path, size: int) -> str:
    """SHA-256 of the first `size` bytes."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while size and (data := file.read(min(size, 1 << 20))):
            digest.update(data)
            size -= len(data)
    return digest.hexdigest()


def _note(root: Path, home: Path, source: str) -> None:
    """Services and the key of authors, where the root does not have them yet."""
    theirs, ours = Layout(root), Layout(home)
    if theirs.identity(source).is_file() and not ours.identity(source).is_file():
        write_bytes(ours.identity(source), theirs.identity(source).read_bytes())
    if theirs.key(source).is_file() and not ours.key(source).is_file():
        write_bytes(ours.key(source), theirs.key(source).read_bytes(), mode=0o600)


def _spent(root: Path, home: Path, source: str) -> int:
    """Add what the other machine has spent, each request once; how many were new."""
    path = Layout(root).state(source)
    if not path.is_file():
        return 0
    with (
        closing(Frontier(path, readonly=True)) as theirs,
        closing(Frontier(Layout(home).state(source))) as ours,
    ):
        return ours.add_ledger(theirs)
