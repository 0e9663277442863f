"""Ends browser processes, also when this process is killed.

A browser consists of many processes, and killing its driver alone leaves the others running. Each
driver therefore leads its own session, and the whole session with all descendants is ended. The
guard is a small process that reads a pipe from us: however we end, the pipe closes, and the guard
ends the sessions that are still registered. If the guard is killed together with us, Linux kills
the driver, and the browser exits because the pipe of its driver closes.
"""

import contextlib
import ctypes
import functools
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


def family(leader: int, folder: str = "") -> list[int]:
    """All processes of the session of `leader`, its descendants, and those that name its folder.

    Chromium's crash handler leaves session and parents at once; the folder in its arguments gives
    it away.
    """
    parents: dict[int, int] = {}
    family = {leader}
    for name in (path.name for path in Path("/proc").iterdir()):
        if not name.isdigit():
            continue
        try:
            with Path(f"/proc/{name}/stat").open(encoding="utf-8", errors="replace") as file:
                fields = file.read().rpartition(")")[2].split()
        except OSError:
            continue
        pid = int(name)
        parents[pid] = int(fields[1])
        if int(fields[3]) == leader or (folder and _names(pid, folder)):
            family.add(pid)
    grown = True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in family} - family
        family |= more
        grown = bool(more)
    return sorted(family & (parents.keys() | {leader}))


def _names(pid: int, folder: str) -> bool:
    try:
        with Path(f"/proc/{pid}/cmdline").open("rb") as file:
            return folder.encode() in file.read()
    except OSError:
        return False


def end(leader: int, folder: str = "") -> None:
    """Kill the family of `leader` until none is left, then remove its folder."""
    for _ in range(50):
        alive = [pid for pid in family(leader, folder) if _kill(pid)]
        if not alive:
            break
        threading.Event().wait(0.02)
    if folder:
        shutil.rmtree(folder, ignore_errors=True)


def _kill(pid: int) -> bool:
    """Whether the process was still there; a zombie that waits for its parent counts as gone."""
    try:
        with Path(f"/proc/{pid}/stat").open(encoding="utf-8", errors="replace") as file:
            if file.read().rpartition(")")[2].split()[0] in "ZX":
                return False
        os.kill(pid, signal.SIGKILL)
        return True
    except OSError:
        return False


def start(command: Sequence[str], env: Mapping[str, str], folder: str) -> subprocess.Popen[bytes]:
    """Start a program in a session of its own, to be killed with us. Its output is piped.

    Raises OSError. `command[0]` is a path.
    """
    run = [sys.executable, "-I", "-S", str(Path(__file__).resolve()), str(os.getpid()), *command]

    def make() -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            run,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=env,
            cwd=folder,
        )

    return _starter(os.getpid()).submit(make).result()


@functools.cache
def _starter(pid: int) -> ThreadPoolExecutor:
    """A thread that lasts as long as the process `pid`: a program is killed with the thread that
    started it, and those that use browsers end before.
    """
    return ThreadPoolExecutor(1, thread_name_prefix=f"starter-{pid}")


def _become(parent: int, command: list[str]) -> None:
    """Be a program that is killed with `parent`, where the system can do that."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() == parent:  # else it has ended already
        os.execv(command[0], command)


class Guard:
    """Our side of the pipe. `watch` and `forget` are lines to the guard process."""

    def __init__(self) -> None:
        # A session of its own: Ctrl-C in the terminal must not end the guard before us.
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", str(Path(__file__).resolve())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env={"PATH": os.defpath},
            cwd="/",
        )
        self._lock = threading.Lock()

    def watch(self, leader: int, folder: str) -> None:
        """End this session and remove this folder when we end."""
        self._say(f"+{leader} {folder}")

    def forget(self, leader: int) -> None:
        """The session was ended already."""
        self._say(f"-{leader}")

    def _say(self, line: str) -> None:
        with self._lock, contextlib.suppress(OSError, ValueError):
            assert self._process.stdin is not None
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()

    def close(self) -> None:
        """Let the guard end what is left."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()


def main() -> None:
    """The guard process: read lines until the pipe ends, then end what was not forgotten."""
    known: dict[int, str] = {}
    for line in sys.stdin:
        leader, _, folder = line[1:].strip().partition(" ")
        if line[0] == "+":
            known[int(leader)] = folder
        else:
            known.pop(int(leader), None)
    for leader, folder in known.items():
        end(leader, folder)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        _become(int(sys.argv[1]), sys.argv[2:])
    else:
        main()
