"""`kb` in a forked process that is killed or stopped before its n-th file operation.

Operations are what a kill can fall between: opening a file to write it, fsync, write, truncate,
rename, remove, making and removing a folder, and each commit of an SQLite database.
"""

from __future__ import annotations

import os
import random
import resource
import signal
import sqlite3
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from kb.core import context
from tests import processes

KILL, PAUSE, TEAR = "kill", "pause", "tear"
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_NAMES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink"}
_CALLS = ("fsync", "write", "pwrite", "ftruncate")
_OPERATIONS, _MOMENT = "operations", "moment"  # files beside what it prints


class Ended(NamedTuple):
    """How a command ended: exit code (negative: the signal), its output, how many file operations
    it made, and the one that it was killed before.
    """

    code: int
    out: str
    err: str
    operations: int
    moment: str


class HarmedProcess(processes.ForkedProcess):
    """A command that is killed, or stopped (PAUSE), before one of its file operations: before the
    one of number `before`, or the first whose description ends with `at`. `largest`: no file that
    it writes may be larger (bytes), which is like a full disk.
    """

    def __init__(
        self,
        words: Sequence[str],
        env: Mapping[str, str],
        cwd: Path,
        harm: str = "",
        before: int = 0,
        at: str = "",
        largest: int = 0,
    ) -> None:
        self._report = tempfile.TemporaryDirectory(prefix="kb-harm-")
        operations = _Operations(cwd, Path(self._report.name), harm, before, at)
        run = partial(_run_harmed, operations=operations, largest=largest)
        super().__init__(run, words, env, cwd)

    def ends_within(self, seconds: float) -> bool:
        """Whether it ends within that time."""
        try:
            self.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def resume(self) -> None:
        """Continue after it has stopped itself."""
        self.send_signal(signal.SIGCONT)

    def end(self, timeout: float = 300) -> Ended:
        """Wait for its end, and kill it when that takes longer."""
        if not self.ends_within(timeout):
            self.kill()
        code, output, report = self.wait(), self.output("replace"), Path(self._report.name)
        operations, moment = (_text(report / name) for name in (_OPERATIONS, _MOMENT))
        self._folder.cleanup()
        self._report.cleanup()
        return Ended(code, *output, int(operations or 0), moment)


def run(words: Sequence[str], env: Mapping[str, str], cwd: Path, **harm: Any) -> Ended:
    """Run `kb WORDS` to its end, whichever that is."""
    return HarmedProcess(words, env, cwd, **harm).end()


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


def _run_harmed(words: list[str], *, operations: _Operations, largest: int) -> None:
    context.default_workers = lambda: 1
    if largest:
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, resource.RLIM_INFINITY))
    operations.watch()
    try:
        processes.run_command(words)
    finally:
        operations.finish()


class _Operations:
    """Counts what the process does to files below `place`, and does harm before one of them."""

    def __init__(self, place: Path, report: Path, harm: str, before: int, at: str) -> None:
        self._count = 0
        self._done = False
        self._place, self._report = str(place), report
        self._harm, self._before, self._at = harm, before, at
        self._synced: dict[str, int] = {}

    def watch(self) -> None:
        """Count from now on, in this process."""
        self._pid = os.getpid()
        for name in _CALLS:
            setattr(os, name, self._wrapped(name, getattr(os, name)))
        sqlite3.connect = self._connecting(sqlite3.connect)
        sys.addaudithook(self._heard)

    def finish(self) -> None:
        """Stop counting, and write down how many operations there were."""
        self._done = True
        (self._report / _OPERATIONS).write_text(str(self._count))

    def _heard(self, event: str, args: tuple[Any, ...]) -> None:
        if event in _NAMES:
            # A name without a folder is one in a folder that is being removed (shutil.rmtree).
            if self._ours(args[0]) or not Path(os.fsdecode(args[0])).is_absolute():
                self._next(" ".join([event, *map(str, args[:2])]))
        elif (
            event == "open"
            and isinstance(args[2], int)
            and args[2] & _WRITES
            and self._ours(args[0])
        ):
            self._next(f"open {args[0]}")

    def _statement(self, sql: str) -> None:
        if sql.lstrip()[:6].upper() == "COMMIT":
            self._next("COMMIT")

    def _connecting(self, connect: Callable[..., Any]) -> Callable[..., Any]:
        def connected(*given: Any, **options: Any) -> Any:
            connection = connect(*given, **options)
            connection.set_trace_callback(self._statement)
            return connection

        return connected

    def _wrapped(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(descriptor: int, *rest: Any) -> Any:
            # Pipes too are written to; a kill while a worker is asked for ends the server.
            if descriptor > 2 and self._ours(path := _path(descriptor)):
                self._next(f"{name} {path}", descriptor if name == "fsync" else -1)
            return call(descriptor, *rest)

        return counted

    def _ours(self, path: Any) -> bool:
        return isinstance(path, str | bytes | os.PathLike) and os.fsdecode(path).startswith(
            self._place
        )

    def _next(self, what: str, descriptor: int = -1) -> None:
        if self._done or os.getpid() != self._pid:
            return
        self._count += 1
        is_it = what.endswith(self._at) if self._at else self._count == self._before
        if not is_it:
            if descriptor >= 0 and stat.S_ISREG((status := os.fstat(descriptor)).st_mode):
                self._synced[_path(descriptor)] = status.st_size
            return
        text = f"{self._count}: {what.replace(self._place + os.sep, '')}"
        (self._report / _MOMENT).write_text(text)
        if self._harm == PAUSE:
            os.kill(self._pid, signal.SIGSTOP)
            return
        if self._harm == TEAR and (synced := self._synced.get(_path(descriptor))) is not None:
            # What was not synced may be there in part after a power cut.
            size = os.fstat(descriptor).st_size
            if size > synced:
                os.truncate(_path(descriptor), random.Random(size).randrange(synced, size))
        os.kill(self._pid, signal.SIGKILL)


def _path(descriptor: int) -> str:
    try:
        return str(Path(f"/proc/self/fd/{descriptor}").readlink())
    except OSError:
        return "?"
