"""`kb` in a process of its own, without the second that its imports take.

The first `run` of a test process starts a server (multiprocessing's forkserver) that has imported
what commands import; each command is then a fork of it, with its own environment, folder, streams,
signals and exit code, as a user's process has them. Only the modules are there already: tests of
what is imported, of signals and of kills start Python themselves (`Job.start`, subprocess).

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
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import kb

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["tests.preloaded"])
# Settings of Lorebase are read by each command; of what else stands in the environment, something
# may have been read by an import, so that a command with another value gets a whole process.
_OURS = ("KB_", "YOUTUBE_", "REDDIT_", "ZENODO_", "SOURCE_DATE_EPOCH", "PYTEST_")
_BY_COMMANDS = {"PYTHONWARNINGS", "RAYON_NUM_THREADS"}  # set by those that ran in this process
_ENVIRONMENT = dict(os.environ)


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
    with tempfile.TemporaryDirectory(prefix="kb-") as folder:
        streams = [Path(folder, name) for name in ("out", "err")]
        child = _CONTEXT.Process(target=_command, args=(words, dict(env), cwd, *streams))
        child.start()
        child.join(timeout)
        late = child.exitcode is None
        if late:
            child.kill()
            child.join()
        out, err = (path.read_text("utf-8") if path.exists() else "" for path in streams)
        code = child.exitcode
        child.close()
    if late:
        raise subprocess.TimeoutExpired(words, timeout, out, err)
    assert code is not None
    return subprocess.CompletedProcess(words, code, out, err)


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


def _command(words: list[str], env: dict[str, str], cwd: Path, out: Path, err: Path) -> None:
    """The forked side: become `python -m kb WORDS`."""
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
    _pools_from_the_server()
    # A process of its own has no frames of a server below it: as much room as it has.
    sys.setrecursionlimit(sys.getrecursionlimit() + len(traceback.extract_stack()))
    sys.argv = ["kb", *words]
    runpy.run_module("kb", run_name="__main__", alter_sys=True)
