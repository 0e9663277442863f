"""`kb` in a process of its own.

Importing `kb` takes a second of CPU time, and the tests run it thousands of times. Each command is
therefore forked from a server (multiprocessing's forkserver) that has imported `kb`; it has its own
environment, working folder, streams, signals and exit code. Tests of imports, or of variables that
libraries read when they are imported, ask for a new interpreter (`fresh`).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pkgutil
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import connection
from pathlib import Path

import kb

# Commands import these late; none of them starts a thread when it is imported.
_LATE = (
    "PIL.PngImagePlugin",
    "googleapiclient.discovery",
    "httpcore2._api",
    "httpx2",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "onnxruntime",
    "selenium.webdriver",
    "tokenizers",
    "tqdm.auto",
    "wordcloud",
)
_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        *(
            module.name
            for module in pkgutil.walk_packages(kb.__path__, "kb.")
            if not module.name.endswith("__main__")
        ),
        *_LATE,
        "tests.processes",
    ]
)


def run(
    words: Sequence[object],
    *,
    env: Mapping[str, str],
    cwd: Path,
    timeout: float = 300,
    fresh: bool = False,
) -> subprocess.CompletedProcess[str]:
    """Run `kb WORDS` to its end; its output is text. Raises subprocess.TimeoutExpired."""
    arguments = [str(word) for word in words]
    if fresh:
        return subprocess.run(
            [sys.executable, "-m", "kb", *arguments],
            cwd=cwd,
            env=dict(env),
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    child = start(arguments, env=env, cwd=cwd)
    try:
        out, err = child.communicate(timeout)
    except subprocess.TimeoutExpired:
        child.kill()
        raise subprocess.TimeoutExpired(arguments, timeout, *child.communicate()) from None
    assert child.returncode is not None
    return subprocess.CompletedProcess(arguments, child.returncode, out, err)


def start(words: Sequence[object], *, env: Mapping[str, str], cwd: Path) -> ForkedProcess:
    """Start `kb WORDS`."""
    return ForkedProcess(run_command, words, env, cwd)


def program(
    code: str, *words: object, env: Mapping[str, str] | None = None, cwd: Path | None = None
) -> ForkedProcess:
    """Start `python -c CODE WORDS`."""
    return ForkedProcess(
        _run_program, [code, *words], os.environ if env is None else env, cwd or Path.cwd()
    )


class ForkedProcess:
    """A process forked from the server, used like subprocess.Popen. Its output goes to files."""

    def __init__(
        self,
        target: Callable[[list[str]], None],
        words: Sequence[object],
        env: Mapping[str, str],
        cwd: Path,
    ) -> None:
        self._words = [str(word) for word in words]
        self._folder = tempfile.TemporaryDirectory(prefix="kb-")
        self.folder = Path(self._folder.name)
        self._process = _CONTEXT.Process(
            target=_enter, args=(target, self._words, dict(env), cwd, self.folder)
        )
        self._process.start()
        assert self._process.pid is not None
        self.pid: int = self._process.pid

    @property
    def returncode(self) -> int | None:
        """The exit code, negative for the signal that ended it; None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """The same as `returncode`."""
        return self.returncode

    def output(self, errors: str = "strict") -> tuple[str, str]:
        """What it has written to stdout and stderr so far."""
        streams = (self.folder / "out", self.folder / "err")
        out, err = (path.read_text("utf-8", errors) if path.exists() else "" for path in streams)
        return out, err

    def lines(self, count: int) -> list[str]:
        """Its lines on stdout, as soon as there are so many or it has ended."""
        while self.output()[0].count("\n") < count and self.returncode is None:
            time.sleep(0.005)
        return self.output()[0].splitlines()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return the exit code. Raises subprocess.TimeoutExpired."""
        connection.wait([self._process.sentinel], timeout)
        code = self.returncode
        if code is None:
            assert timeout is not None
            raise subprocess.TimeoutExpired(self._words, timeout)
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for its end and return its output."""
        self.wait(timeout)
        return self.output()

    def has_stopped(self, timeout: float = 120) -> bool:
        """Wait until it stops itself (SIGSTOP); False when it ends before."""
        end = time.monotonic() + timeout
        while self.returncode is None and time.monotonic() < end:
            if is_stopped(self.pid):
                return True
            time.sleep(0.005)
        return False

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.returncode is None:
            # It may have ended before the server has reported it.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


def is_stopped(pid: int) -> bool:
    """Whether a process is in the stopped state."""
    try:
        state = Path("/proc", str(pid), "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state == "T"


def _enter(
    target: Callable[[list[str]], None], words: list[str], env: dict[str, str], cwd: Path, at: Path
) -> None:
    """Take on streams, environment and working folder, then call the target."""
    for number, path in enumerate((os.devnull, at / "out", at / "err")):
        opened = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    os.environ.clear()
    os.environ.update(env)
    time.tzset()
    os.chdir(cwd)
    target(words)


def run_command(words: list[str]) -> None:
    """Become `python -m kb WORDS`."""
    sys.argv = ["kb", *words]
    runpy.run_module("kb", run_name="__main__", alter_sys=True)


def _run_program(words: list[str]) -> None:
    sys.argv = ["-c", *words[1:]]
    exec(compile(words[0], "<program>", "exec"), {"__name__": "__main__"})
