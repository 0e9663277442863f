"""`kb` in a forked process that is killed or stopped before its n-th file operation.

Operations are what a kill can fall between: opening a file to write it, fsync, write, truncate,
rename, remove, making and removing a folder, and each commit of an SQLite database.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import stat
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from kb.core import context
from tests import forked

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


class Child(forked.Started):
    """A command on its way, to be killed or stopped (PAUSE) before an operation of that number."""

    def __init__(
        self,
        words: Sequence[str],
        env: Mapping[str, str],
        cwd: Path,
        harm: str = "",
        before: int = 0,
    ) -> None:
        super().__init__(partial(_harmed, harm=harm, before=before), words, env, cwd)

    def ended(self, seconds: float) -> bool:
        """Whether it ends within that time."""
        try:
            self.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def go_on(self) -> None:
        """After `stopped`."""
        self.send_signal(signal.SIGCONT)

    def end(self, timeout: float = 300) -> Ended:
        """Its end; it is killed where that takes longer."""
        if not self.ended(timeout):
            self.kill()
        code, said, place = self.wait(), self.said("replace"), self._out.parent
        operations, moment = (_text(place / name) for name in (_OPERATIONS, _MOMENT))
        self._folder.cleanup()
        return Ended(code, *said, int(operations or 0), moment)


def run(words: Sequence[str], env: Mapping[str, str], cwd: Path, **harm: Any) -> Ended:
    """`kb WORDS`, ended one way or another."""
    return Child(words, env, cwd, **harm).end()


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


def _harmed(
    words: list[str],
    env: dict[str, str],
    cwd: Path,
    out: Path,
    err: Path,
    *,
    harm: str,
    before: int,
) -> None:
    """The forked side."""
    # A pool's processes come from the same server, which ends with a kill while one is asked for.
    context.default_workers = lambda: 1
    operations = _Operations(cwd, out.with_name(_MOMENT), harm, before)
    operations.watch()
    try:
        forked._command(words, env, cwd, out, err)
    finally:
        operations.done = True
        out.with_name(_OPERATIONS).write_text(str(operations.count))


class _Operations:
    """Counts what the process does to files below `place`, and does harm before one of them."""

    def __init__(self, place: Path, moment: Path, harm: str, before: int) -> None:
        self.count = 0
        self.done = False
        self._place, self._moment, self._harm, self._before = str(place), moment, harm, before
        self._pid = os.getpid()
        self._synced: dict[str, int] = {}

    def watch(self) -> None:
        """From now on."""
        for name in _CALLS:
            setattr(os, name, self._wrapped(name, getattr(os, name)))
        sqlite3.connect = self._connecting(sqlite3.connect)
        sys.addaudithook(self._heard)

    def _heard(self, event: str, args: tuple[Any, ...]) -> None:
        if event in _NAMES:
            # A name without a folder is one in a folder that is being removed (shutil.rmtree).
            if self._ours(args[0]) or not Path(os.fsdecode(args[0])).is_absolute():
                self._next(f"{event} {args[0]}")
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
        if self.done or os.getpid() != self._pid:
            return
        self.count += 1
        if self.count != self._before:
            if descriptor >= 0 and stat.S_ISREG((found := os.fstat(descriptor)).st_mode):
                self._synced[_path(descriptor)] = found.st_size
            return
        self._moment.write_text(f"{self.count}: {what.replace(self._place + os.sep, '')}")
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
