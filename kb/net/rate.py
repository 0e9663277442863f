"""Pace: how close together requests may be, over all threads of a process."""

import math
import threading

from kb.core import clock


class Pace:
    """At least `seconds` between the starts of any two requests. Thread-safe."""

    def __init__(self, seconds: float = 0.0) -> None:
        self._seconds = max(0.0, seconds)
        self._next = 0.0
        self._lock = threading.Lock()

    def at_least(self, seconds: float) -> None:
        """Never faster than this (a crawl-delay that is read later)."""
        with self._lock:
            self._seconds = max(self._seconds, seconds)

    def rest(self, seconds: float) -> None:
        """Nobody asks anything for so long (Retry-After counts for all threads)."""
        with self._lock:
            self._next = max(self._next, clock.monotonic() + seconds)

    def wait(self) -> None:
        """Wait for one's turn. Raises Interrupted when the run is asked to end."""
        self.wait_within(math.inf)

    def wait_within(self, seconds: float) -> bool:
        """Wait for one's turn when it comes within so many seconds; else False, no turn is taken.

        Raises Interrupted when the run is asked to end.
        """
        with self._lock:
            now = clock.monotonic()
            start = max(now, self._next)
            if start - now > seconds:
                return False
            self._next = start + self._seconds
        clock.sleep(start - clock.monotonic())
        return True
