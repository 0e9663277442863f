"""Progress of long work: what a stage reports, whoever shows it."""

from __future__ import annotations

import sys
import threading
from typing import Protocol, TextIO

from kb.core import clock, terminal


class Task(Protocol):
    """One bar: `advance` counts items and names figures to show beside it."""

    def advance(self, n: int = 1, **facts: object) -> None: ...

    def close(self) -> None: ...


class Progress(Protocol):
    """Where tasks are shown."""

    def task(self, name: str, total: int | None = None, unit: str = "") -> Task: ...

    def say(self, text: str) -> None: ...


class SilentTask:
    """Shows nothing."""

    def advance(self, n: int = 1, **facts: object) -> None:
        """Nothing to show."""

    def close(self) -> None:
        """Nothing to end."""


class Silent:
    """`--quiet`, and the default in Python code."""

    def task(self, name: str, total: int | None = None, unit: str = "") -> Task:
        """A task that shows nothing."""
        return SilentTask()

    def say(self, text: str) -> None:
        """Nothing to show."""


class PlainTask:
    """A line at most every `every` seconds, and one at the end."""

    def __init__(
        self, name: str, total: int | None, unit: str, stream: TextIO, every: float
    ) -> None:
        self._name, self._total, self._unit, self._stream, self._every = (
            name,
            total,
            unit,
            stream,
            every,
        )
        self._done = 0
        self._facts: dict[str, object] = {}
        self._start = self._last = clock.monotonic()
        self._lock = threading.Lock()

    def advance(self, n: int = 1, **facts: object) -> None:
        """Count `n` more items; show a line when the last one is old enough."""
        with self._lock:
            self._done += n
            self._facts.update(facts)
            if clock.monotonic() - self._last >= self._every:
                self._show()

    def close(self) -> None:
        """Show the final figures."""
        with self._lock:
            self._show()

    def _show(self) -> None:
        self._last = clock.monotonic()
        spent = max(self._last - self._start, 1e-9)
        rate = self._done / spent
        parts = [
            f"{self._name}: {self._done}"
            + (f"/{self._total}" if self._total else "")
            + (f" {self._unit}" if self._unit else "")
        ]
        parts.append(f"{rate:.1f}/s" if rate >= 0.1 else f"{rate * 60:.1f}/min")
        if self._total and self._done and self._done < self._total:
            parts.append(f"{_span((self._total - self._done) / rate)} left")
        parts += [f"{name.replace('_', ' ')} {value}" for name, value in self._facts.items()]
        print(", ".join(parts), file=self._stream, flush=True)


class Plain:
    """Lines on a stream that is no terminal."""

    def __init__(self, stream: TextIO | None = None, every: float = 10.0) -> None:
        self._stream, self._every = stream or sys.stderr, every

    def task(self, name: str, total: int | None = None, unit: str = "") -> Task:
        """A task that prints lines."""
        return PlainTask(name, total, unit, self._stream, self._every)

    def say(self, text: str) -> None:
        """One line."""
        print(terminal.one_line(text), file=self._stream, flush=True)


def _span(seconds: float) -> str:
    """Seconds as the two largest units, "3h 20m"."""
    minutes, _ = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days}d {hours}h"
    return f"{hours}h {minutes}m" if hours else f"{minutes}m {int(seconds) % 60}s"
