"""A command's wall time, the CPU time of its whole process tree, and the tree's peak memory."""

import contextlib
import os
import subprocess
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import psutil

EVERY = 0.1  # seconds between two looks at the memory


class Measured(NamedTuple):
    """Seconds, CPU seconds and MiB; the exit code and what was said."""

    wall: float
    cpu: float
    peak: float
    code: int
    said: str


def run(
    command: Sequence[str],
    env: Mapping[str, str],
    cwd: Path,
    until: Callable[[], bool] | None = None,
) -> Measured:
    """Run a command to its end, or until `until` says so; it and its children are ended then.

    Memory is the proportional share of pages (PSS), so that what workers share counts once. CPU
    time is what the kernel says of the process and the children that it waited for.
    """
    begin = time.perf_counter()
    with subprocess.Popen(
        command, env=dict(env), cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        ended, peaks = threading.Event(), [0.0]
        watcher = threading.Thread(target=_watch, args=(process.pid, ended, peaks), daemon=True)
        watcher.start()
        cut: list[float] = []
        if until is not None:
            while not _ended(process.pid):
                if until():
                    cut = [time.perf_counter() - begin, _cpu_so_far(process.pid)]
                    _end(process)
                    break
                time.sleep(EVERY / 10)
        said = process.stdout.read() if process.stdout else b""
        if cut:
            process.wait()
            code, wall, cpu = 0, *cut
        else:
            _, status, usage = os.wait4(process.pid, 0)
            code = process.returncode = os.waitstatus_to_exitcode(status)
            wall, cpu = time.perf_counter() - begin, usage.ru_utime + usage.ru_stime
        ended.set()
        watcher.join()
    return Measured(wall, cpu, peaks[0], code, said.decode("utf-8", "replace"))


def _ended(pid: int) -> bool:
    """Whether a child has ended; it still waits to be asked what it used."""
    look = os.WEXITED | os.WNOHANG | os.WNOWAIT
    return os.waitid(os.P_PID, pid, look) is not None


def _watch(pid: int, ended: threading.Event, peaks: list[float]) -> None:
    while not ended.wait(EVERY):
        peaks[0] = max(peaks[0], sum(map(_memory, _tree(pid))))


def _tree(pid: int) -> list[int]:
    with contextlib.suppress(psutil.Error):
        return [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
    return []


def _memory(pid: int) -> float:
    with contextlib.suppress(OSError):
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
        for line in text.splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024
    return 0.0


def _cpu_so_far(pid: int) -> float:
    spent = 0.0
    for each in _tree(pid):
        with contextlib.suppress(psutil.Error):
            times = psutil.Process(each).cpu_times()
            own = times.user + times.system
            spent += own + times.children_user + times.children_system
    return spent


def _end(process: subprocess.Popen[bytes]) -> None:
    for pid in reversed(_tree(process.pid)):
        with contextlib.suppress(psutil.Error):
            psutil.Process(pid).kill()


def words_a_second(words: int, work: Callable[[], object], least: float = 1.0) -> float:
    """Words a CPU second; the best of runs that take `least` seconds together,
    after one to warm up.
    """
    best, spent = float("inf"), 0.0
    work()
    while spent < least:
        begin = time.process_time()
        work()
        took = time.process_time() - begin
        best, spent = min(best, took), spent + took
    return words / best
