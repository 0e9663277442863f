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
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kb.core import context
from tests import forked

KILL, PAUSE, TEAR = "kill", "pause", "tear"
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_NAMES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.link", "os.symlink"}
# Starting a process polls all others, and only one thread may read how one ended.
_ONE = threading.Lock()
_CALLS = ("fsync", "write", "pwrite", "ftruncate")


class Ended(NamedTuple):
    """How a command ended: exit code (negative: the signal), its output, how many file operations
    it made, and the one that it was killed before.
    """

    code: int
    out: str
    err: str
    operations: int
    moment: str


class Child:
    """A command on its way. `wait` for its end, or `stopped` by PAUSE."""

    def __init__(
        self,
        words: Sequence[str],
        env: Mapping[str, str],
        cwd: Path,
        harm: str = "",
        before: int = 0,
    ) -> None:
        self._words = list(words)
        self._folder = tempfile.TemporaryDirectory(prefix="kb-")
        self._said = Path(self._folder.name)
        given = (self._words, dict(env), cwd, self._said, harm, before)
        self._process = forked._CONTEXT.Process(target=_harmed, args=given)
        with _ONE:
            self._process.start()
        assert self._process.pid is not None
        self.pid: int = self._process.pid

    def stopped(self, timeout: float = 120) -> bool:
        """Whether it has stopped itself, and not ended before."""
        end = time.monotonic() + timeout
        while self._code() is None and time.monotonic() < end:
            if forked.is_stopped(self.pid):
                return True
            time.sleep(0.005)
        return False

    def ended(self, seconds: float) -> bool:
        """Whether it ends within that time."""
        end = time.monotonic() + seconds
        while (code := self._code()) is None and time.monotonic() < end:
            time.sleep(0.003)
        return code is not None

    def _code(self) -> int | None:
        with _ONE:
            return self._process.exitcode

    def go_on(self) -> None:
        """After `stopped`."""
        os.kill(self.pid, signal.SIGCONT)

    def wait(self, timeout: float = 300) -> Ended:
        """Its end."""
        if not self.ended(timeout):
            self._process.kill()
        while (code := self._code()) is None:
            time.sleep(0.003)
        self._process.close()
        texts = [_text(self._said / name) for name in ("out", "err", "operations", "moment")]
        self._folder.cleanup()
        return Ended(code, texts[0], texts[1], int(texts[2] or 0), texts[3])


def run(words: Sequence[str], env: Mapping[str, str], cwd: Path, **harm: Any) -> Ended:
    """`kb WORDS`, ended one way or another."""
    return Child(words, env, cwd, **harm).wait()


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


def _harmed(
    words: list[str], env: dict[str, str], cwd: Path, said: Path, harm: str, before: int
) -> None:
    """The forked side."""
    # A pool's processes come from the same server, which ends with a kill while one is asked for.
    context.default_workers = lambda: 1
    operations = _Operations(cwd, said / "moment", harm, before)
    operations.watch()
    try:
        forked._command(words, env, cwd, said / "out", said / "err")
    finally:
        operations.done = True
        (said / "operations").write_text(str(operations.count))


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
