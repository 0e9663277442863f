"""One writer per source and data root, held by the kernel, so that a crash frees it."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from kb.core.errors import WriterLocked
from kb.store.atomic import full_disk_is_resumable


@contextlib.contextmanager
def writer(root: Path, source: str) -> Iterator[None]:
    """Hold the right to write to a source. Raises WriterLocked naming the holder's pid."""
    path = root / "state" / f"{source}.lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, 32).decode(errors="replace").strip() or "unknown"
            raise WriterLocked(
                f"another process (pid {holder}) writes to {source} in {root}",
                hint="wait for it, or stop it; a second machine takes its own --data folder",
            ) from None
        with full_disk_is_resumable(path):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
        os.ftruncate(descriptor, 0)
    finally:
        os.close(descriptor)
