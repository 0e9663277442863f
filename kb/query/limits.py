"""Limits of a query: time, memory, room to spill.

DuckDB's own memory limit does not count every text that it builds (`repeat('x', 3e9)`), and not
every operator reacts to an interruption. So the process gets a memory limit while a query runs, and
exits if the query ignores its time limit.
"""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import duckdb

from kb.core.errors import FatalError, KbError

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]

_GRACE = 5.0  # seconds from the interruption to the end of the process
_POLL = 0.5  # seconds
_CPU = 4  # CPU seconds per second of the time limit
_PROCESS = 1 << 30  # bytes that the process needs besides the query


@dataclass(frozen=True)
class Limits:
    """Seconds, bytes of memory, bytes to spill to disk, and threads (None: DuckDB's choice)."""

    seconds: float
    memory: int
    spill: int = 0
    threads: int | None = None


def for_people(seconds: float) -> Limits:
    """For a person's query: half of the machine's memory, and four times that on disk."""
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    return Limits(seconds, memory=half, spill=4 * half)


@contextlib.contextmanager
def limited(con: duckdb.DuckDBPyConnection, limits: Limits) -> Iterator[None]:
    """Run the block, in which one query of `con` runs and is read, within its limits.

    Raises FatalError if it takes too long or too much memory.
    """
    late = threading.Event()

    def interrupt() -> None:
        late.set()
        con.interrupt()

    timers = [
        threading.Timer(limits.seconds, interrupt),
        threading.Timer(limits.seconds + _GRACE, _exit, [limits.seconds]),
    ]
    for timer in timers:
        timer.daemon = True
        timer.start()
    try:
        with _memory(limits.memory + _PROCESS):
            yield
    except MemoryError:
        raise FatalError("the query needs too much memory", hint="ask for less at a time") from None
    except (duckdb.Error, KbError, OSError) as error:  # what an interrupted query raises
        if late.is_set():
            raise timed_out(limits.seconds) from error
        raise
    finally:
        for timer in timers:
            timer.cancel()
        for timer in timers:  # a timer that outlives the interpreter keeps the connection alive
            timer.join()


def restrict_process(limits: Limits, parent: int) -> None:
    """For the rest of this process: write no file, use limited CPU time, end with the parent (a
    process id).
    """
    threading.Thread(target=_exit_with, args=[parent], daemon=True).start()
    if resource is None:
        return
    seconds = int(_CPU * limits.seconds) + 20
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _exit_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL)
    os._exit(1)


def timed_out(seconds: float) -> FatalError:
    return FatalError(
        f"the query took longer than {seconds:g} s", hint="ask for less, or raise the time limit"
    )


def _exit(seconds: float) -> None:
    error = timed_out(seconds)
    print(f"kb: {error}; {error.hint}", file=sys.stderr, flush=True)
    os._exit(1)


@contextlib.contextmanager
def _memory(limit: int) -> Iterator[None]:
    """Limit this process's data to so many bytes, where the system supports it."""
    if resource is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    lower = limit if before[1] == resource.RLIM_INFINITY else min(limit, before[1])
    resource.setrlimit(resource.RLIMIT_DATA, (lower, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
