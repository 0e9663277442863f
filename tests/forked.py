"""`kb` in a process of its own, without the second that its imports take.

The first `run` of a test process starts a server (multiprocessing's forkserver) that has imported
what commands import; each command is then a fork of it, with its own environment, folder, streams,
signals and exit code, as a user's process has them. `start` is the same for one that is to be
killed or signalled on its way, `program` for a few lines of Python. Only the modules are there
already: tests of what is imported or how Python starts run it themselves (subprocess).

Worker processes of a pool (`--workers 2`) come from the same server, those of commands and those of
a test that calls a room in its own process.
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import pkgutil
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing import connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import kb

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["tests.preloaded"])
# Settings of Lorecrawl are read by each command; of what else stands in the environment, something
# may have been read by an import, so that a command with another value gets a whole process.
_OURS = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_", "SOURCE_DATE_EPOCH", "PYTEST_")
_BY_COMMANDS = {"PYTHONWARNINGS", "RAYON_NUM_THREADS"}  # set by those that ran in this process
_ENVIRONMENT = dict(os.environ)
# Starting a process polls all others, and only one thread may read how one ended.
_ONE = threading.Lock()


def between_tests() -> None:
    """What libraries have set in the environment of this process (allocators, thread counts, cache
    folders) is no wish of a test: only what differs from now on asks for a whole process.
    """
    _ENVIRONMENT.clear()
    _ENVIRONMENT.update(os.environ)


def sync_nothing() -> None:
    """From now on this process waits for no disk: no test cuts the power, and what a killed process
    wrote is there without. tests/crash/harm.py sees each call as before.
    """
    from kb.store import state

    os.fsync = lambda descriptor: None
    state.SYNCHRONOUS = "OFF"


def import_kb() -> None:
    """Import every module of `kb`: what is forked from here on needn't."""
    for found in pkgutil.walk_packages(kb.__path__, "kb."):
        if not found.name.endswith("__main__"):
            with contextlib.suppress(ImportError):  # of an extra that is not installed
                importlib.import_module(found.name)


def run(
    words: Sequence[str], *, env: Mapping[str, str], cwd: Path, timeout: float
) -> subprocess.CompletedProcess[str]:
    """`kb WORDS`, finished, with its output as text. Raises subprocess.TimeoutExpired."""
    words = [str(word) for word in words]
    if _foreign(env) != _foreign(_ENVIRONMENT):
        return subprocess.run(
            [sys.executable, "-m", "kb", *words],
            cwd=cwd,
            env=dict(env),
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    child = Started(_command, words, env, cwd)
    try:
        out, err = child.communicate(timeout)
    except subprocess.TimeoutExpired:
        child.kill()
        raise subprocess.TimeoutExpired(words, timeout, *child.communicate()) from None
    assert child.returncode is not None
    return subprocess.CompletedProcess(words, child.returncode, out, err)


def start(words: Sequence[str], *, env: Mapping[str, str], cwd: Path) -> Started:
    """`kb WORDS` on its way. Its pools start processes of their own, as a user's do: a kill while
    the server is asked for one would end the server.
    """
    return Started(partial(_command, pools=False), [str(word) for word in words], env, cwd)


def program(
    code: str, *words: object, env: Mapping[str, str] | None = None, cwd: Path | None = None
) -> Started:
    """`python -c CODE WORDS` on its way."""
    given = [code, *map(str, words)]
    return Started(_program, given, os.environ if env is None else env, cwd or Path.cwd())


class Started:
    """A fork of the server, used like subprocess.Popen; what it prints is text in files."""

    def __init__(
        self,
        target: Callable[..., None],
        words: Sequence[str],
        env: Mapping[str, str],
        cwd: Path,
    ) -> None:
        self._words = list(words)
        self._folder = tempfile.TemporaryDirectory(prefix="kb-")
        streams = [Path(self._folder.name, name) for name in ("out", "err")]
        self._out, self._err = streams
        self._process = _CONTEXT.Process(
            target=target, args=(self._words, dict(env), cwd, *streams)
        )
        with _ONE:
            self._process.start()
        assert self._process.pid is not None
        self.pid: int = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Its exit code, negative for the signal that ended it; None while it runs."""
        with _ONE:
            return self._process.exitcode

    def poll(self) -> int | None:
        """As `returncode`."""
        return self.returncode

    def said(self, errors: str = "strict") -> tuple[str, str]:
        """What it has printed until now, and to stderr; `errors` as decoding has them."""
        streams = (self._out, self._err)
        out, err = (path.read_text("utf-8", errors) if path.exists() else "" for path in streams)
        return out, err

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code. Raises subprocess.TimeoutExpired."""
        connection.wait([self._process.sentinel], timeout)
        code = self.returncode
        if code is None:
            assert timeout is not None
            raise subprocess.TimeoutExpired(self._words, timeout)
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """What it has printed, at its end. Raises subprocess.TimeoutExpired."""
        self.wait(timeout)
        return self.said()

    def stopped(self, timeout: float = 120) -> bool:
        """Whether it has stopped itself (SIGSTOP), and not ended before."""
        end = time.monotonic() + timeout
        while self.returncode is None and time.monotonic() < end:
            if is_stopped(self.pid):
                return True
            time.sleep(0.005)
        return False

    def send_signal(self, number: int) -> None:
        """Unless it has ended."""
        if self.returncode is None:
            # The server hears of an end a moment before it says so.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)


def is_stopped(pid: int) -> bool:
    """Whether a process stands still."""
    try:
        state = Path("/proc", str(pid), "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state == "T"


def _foreign(env: Mapping[str, str]) -> dict[str, str]:
    return {
        name: value
        for name, value in env.items()
        if not name.startswith(_OURS) and name not in _BY_COMMANDS
    }


class _Worker(_CONTEXT.Process):  # type: ignore[name-defined,misc]
    """A worker process of a command: a fork of the same server, with the command's environment."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._environment = dict(os.environ)
        self._folder = Path.cwd()

    def run(self) -> None:
        """What a worker does, where the command is."""
        os.environ.clear()
        os.environ.update(self._environment)
        os.chdir(self._folder)
        super().run()


class _Pools(type(_CONTEXT)):  # type: ignore[misc]
    """The start method of worker pools."""

    Process = _Worker


def seam() -> Any:
    """What stands for `multiprocessing` in kb/core/engine.py while pools are forked."""
    made = SimpleNamespace(**vars(multiprocessing))
    made.get_context = lambda method: _Pools()
    return made


def _pools_from_the_server() -> None:
    """`--workers N` of this command forks N processes of the server that it came from.

    Where Python has no such thing (it keeps no promise about the server's inside), workers start as
    ever.
    """
    from multiprocessing import forkserver

    from kb.core import engine

    server = getattr(forkserver, "_forkserver", None)
    address = getattr(server, "_forkserver_address", None)
    key = getattr(server, "_forkserver_authkey", b"")  # of newer versions, and not handed down
    if address and key is not None:
        server.ensure_running = lambda: None  # it is the parent
        engine.multiprocessing = seam()


def _command(
    words: list[str], env: dict[str, str], cwd: Path, out: Path, err: Path, *, pools: bool = True
) -> None:
    """The forked side: become `python -m kb WORDS`."""
    _become(env, cwd, out, err)
    if pools:
        _pools_from_the_server()
    sys.argv = ["kb", *words]
    runpy.run_module("kb", run_name="__main__", alter_sys=True)


def _program(words: list[str], env: dict[str, str], cwd: Path, out: Path, err: Path) -> None:
    _become(env, cwd, out, err)
    sys.argv = ["-c", *words[1:]]
    exec(compile(words[0], "<program>", "exec"), {"__name__": "__main__"})


def _become(env: dict[str, str], cwd: Path, out: Path, err: Path) -> None:
    """Streams, environment, folder and what a new process has."""
    for number, path, flags in (
        (0, Path(os.devnull), os.O_RDONLY),
        (1, out, os.O_WRONLY | os.O_CREAT),
        (2, err, os.O_WRONLY | os.O_CREAT),
    ):
        opened = os.open(path, flags, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    os.environ.clear()
    os.environ.update(env)
    time.tzset()
    os.chdir(cwd)
    from kb.core import telemetry

    telemetry.switch_off()  # as `import kb` does
    # A process of its own has no frames of a server below it: as much room as it has.
    sys.setrecursionlimit(sys.getrecursionlimit() + len(traceback.extract_stack()))
