"""Locks for writers, held by the kernel, so that a crash releases them.

    youtube wiki reddit    raw/, state/, annotations/ and clean/ of a source
    deposits               what was uploaded
    every other            the folders of the artifacts that name it (kb.store.artifact_registry)

A command acquires the locks of all folders that it writes, and of those that it reads as a unit
(`pairs`, `links` and exports read clean/, so a filter and a purge acquire their locks as well),
always in the same order, so that two commands cannot wait for each other. A second command ends
with one line at once. Readers of single files (`kb query`, `kb status`) acquire none. Acquiring a
lock removes what killed commands left in its folders (kb.store.leftovers).
"""

import contextlib
import fcntl
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import WriterLocked
from kb.core.sources import PUBLISHED, SOURCES
from kb.store import leftovers
from kb.store.artifact_registry import ARTIFACTS
from kb.store.exhausted import full_disk_is_resumable
from kb.store.layout import Layout

RELEASES = tuple(f"release-{name}" for name in PUBLISHED)
INDEXES = tuple(f"index-{name}" for name in SOURCES)
RESTORED = ("restored", "reconstructed")
ORDER = (*PUBLISHED, "labels", *RELEASES, *INDEXES, *RESTORED, "report", "deposits")

_ATTEMPTS = 10
_PAUSE = 0.01  # seconds between two attempts: longer than `_holder` takes

_taken: set[Path] = set()  # by `taking` of this process, whose own steps may take them again


def of_clean(source: str) -> tuple[str, ...]:
    """The locks for writing clean/<source>: the source's own and those of commands that read it.

    A report reads single files only.
    """
    readers = [
        artifact.lock for artifact in ARTIFACTS.values() if f"clean/{source}" in artifact.inputs
    ]
    return tuple(dict.fromkeys((source, *(lock for lock in readers if lock != "report"))))


def of_purge(source: str) -> tuple[str, ...]:
    """The locks of a purge: everything that is made of the source, labels, what was brought back of
    it, and the releases of what is made of sources, whose descriptions are written again.
    """
    releases = (f"release-{name}" for name in PUBLISHED if name not in SOURCES)
    return (*of_clean(source), "labels", *releases, *RESTORED, "report")


@contextlib.contextmanager
def writer(root: Path, name: str) -> Iterator[None]:
    """Hold the right to write, by a name above. Raises WriterLocked naming the holder's pid."""
    path = Layout(root).lock(name)
    if path.resolve() in _taken:
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if not _take(descriptor):
            holder, host = _held_by(descriptor)
            where = f" on {host}" if host not in ("", platform.node()) else ""
            what = name.replace("release-", "release/").replace("index-", "index/")
            raise WriterLocked(
                f"another process (pid {holder}{where}) writes to {what} in {root}",
                hint="wait for it, or stop it; a second machine takes its own --data folder",
            )
        with full_disk_is_resumable(path):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n{platform.node()}\n".encode(), 0)
        leftovers.sweep(root, name)
        yield
        os.ftruncate(descriptor, 0)
    finally:
        os.close(descriptor)


def _take(descriptor: int) -> bool:
    """Whether the lock is ours now. `_holder` of another process has it for microseconds."""
    for attempt in range(_ATTEMPTS):
        if attempt:
            time.sleep(_PAUSE)
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    return False


@contextlib.contextmanager
def taking(root: Path, *names: str) -> Iterator[None]:
    """Hold several, in their order; what is called meanwhile may take them again.

    Nothing is taken, and nothing written, where there is no data root. Raises WriterLocked.
    """
    if not root.is_dir():
        yield
        return
    with contextlib.ExitStack() as stack:
        for name in sorted(set(names), key=ORDER.index):
            path = Layout(root).lock(name).resolve()
            if path not in _taken:
                stack.enter_context(writer(root, name))
                _taken.add(path)
                stack.callback(_taken.discard, path)
        yield


def holders(root: Path) -> dict[str, str]:
    """By lock, the pid of another process that holds it now."""
    holders = {}
    for name in ORDER:
        path = Layout(root).lock(name)
        # Ours, or nobody's: whoever holds it has written its number.
        if path.resolve() in _taken or not path.exists() or not path.stat().st_size:
            continue
        if holder := _holder(path):
            holders[name] = holder
    return holders


def _holder(path: Path) -> str:
    """Who holds a lock now, "unknown" before it has written its number; "" for nobody."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # of a FIFO nobody waits
    except FileNotFoundError:
        return ""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _held_by(descriptor)[0]
    finally:
        os.close(descriptor)
    return ""


def _held_by(descriptor: int) -> tuple[str, str]:
    """The pid of the holder and its machine, "unknown" and "" before it has written them."""
    lines = os.read(descriptor, 256).decode(errors="replace").split("\n")
    return lines[0].strip() or "unknown", lines[1] if len(lines) > 1 else ""


def used(root: Path) -> dict[str, int]:
    """By lock, when it was taken or given back last, in nanoseconds."""
    paths = {name: Layout(root).lock(name) for name in ORDER}
    return {name: path.stat().st_mtime_ns for name, path in paths.items() if path.exists()}


def another(root: Path) -> str:
    """The pid of another process that writes to any source of a data root now, "" for none."""
    holders = (_holder(Layout(root).lock(name)) for name in SOURCES)
    return next((holder for holder in holders if holder not in ("", str(os.getpid()))), "")


@contextlib.contextmanager
def deciding(path: Path) -> Iterator[None]:
    """One process at a time reads a note and writes it; others wait for a moment."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path.with_name(f"{path.stem}.lock"), os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
