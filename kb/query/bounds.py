"""How much a query may take: memory, room to spill, and time.

DuckDB's own memory limit does not count every text that it builds (`repeat('x', 3e9)`), and not
every step hears of an interruption. So the process gets a limit of its own while a query runs, and
ends itself where the query does not end in time.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import duckdb

from kb.core.errors import FatalError

try:
    import resource
except ImportError:  # not on Windows
    resource = None  # type: ignore[assignment]

_GRACE = 5.0  # seconds from an interruption to the end of the process
_LOOK = 0.5  # seconds
_CPU = 4  # seconds of processors a second
_BESIDE = 1 << 30  # bytes of the process that are not the query's


@dataclass(frozen=True)
class Limits:
    """Seconds, bytes of memory, bytes on disk for what memory does not hold, and threads (None:
    DuckDB's choice).
    """

    seconds: float
    memory: int
    spill: int = 0
    threads: int | None = None


def generous(seconds: float) -> Limits:
    """What a person's query may take: half of the machine's memory, as much on disk four times."""
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    return Limits(seconds, memory=half, spill=4 * half)


@contextlib.contextmanager
def bounded(con: duckdb.DuckDBPyConnection, limits: Limits) -> Iterator[None]:
    """The block, which runs and reads one query of `con`, within its limits.

    Raises FatalError where it took too long or too much memory.
    """
    late = threading.Event()

    def interrupt() -> None:
        late.set()
        con.interrupt()

    timers = [
        threading.Timer(limits.seconds, interrupt),
        threading.Timer(limits.seconds + _GRACE, _end, [limits.seconds]),
    ]
    for timer in timers:
        timer.daemon = True
        timer.start()
    try:
        with _memory(limits.memory + _BESIDE):
            yield
    except MemoryError:
        raise FatalError("the query needs too much memory", hint="ask for less at a time") from None
    except Exception:
        if late.is_set():
            raise too_long(limits.seconds) from None
        raise
    finally:
        for timer in timers:
            timer.cancel()
        for timer in timers:  # one that outlives the interpreter keeps the connection: a leak, told
            timer.join()


def strict(limits: Limits, parent: int) -> None:
    """For the rest of this process: no file of any size is written, the processors' time is
    limited, and it ends when its parent (a process id) is gone.
    """
    threading.Thread(target=_with, args=[parent], daemon=True).start()
    if resource is None:
        return
    seconds = int(_CPU * limits.seconds) + 20
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)


def too_long(seconds: float) -> FatalError:
    """What is said of a query that does not end."""
    return FatalError(
        f"the query took longer than {seconds:g} s", hint="ask for less, or allow it more time"
    )


def _end(seconds: float) -> None:
    error = too_long(seconds)
    print(f"kb: {error}; {error.hint}", file=sys.stderr, flush=True)
    os._exit(1)


@contextlib.contextmanager
def _memory(most: int) -> Iterator[None]:
    """At most so many bytes of data in this process, as far as the system can say so."""
    if resource is None:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    least = most if before[1] == resource.RLIM_INFINITY else min(most, before[1])
    resource.setrlimit(resource.RLIMIT_DATA, (least, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
