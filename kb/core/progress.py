"""Progress of long work: what a stage reports, whoever shows it.

waiting = lambda: frontier.waiting("videos")
with run.progress.task("metadata", unit="videos", waiting=waiting) as task:
    task.advance(50, quota="21/10,000")

The total is what is known now: given once, or what is done and what `waiting` says; it grows as
discovery finds more. A task that an error ends stays as it is, partial.
"""

import sys
import threading
from collections.abc import Callable
from typing import Self, TextIO

from kb.core import clock, terminal

RECOUNT_S = 0.5  # how often `waiting` is asked: it may read a large state
SETTLED_S = 5.0  # before that, and that long after the total grew, the time left would be a guess


class Task:
    """One bar, which shows nothing: `advance` counts items and names figures to show beside it.

    As a context manager it knows whether an error ended it.
    """

    def advance(self, n: int = 1, **facts: object) -> None:
        """Count `n` more items and keep the newest figures."""

    def expect(self, more: int) -> None:
        """So many are still to come, where that is found out on the way."""

    def close(self, *, stopped: bool = False) -> None:
        """No more will come. What never had a total is whole now, unless it was `stopped`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self.close(stopped=kind is not None)


class Progress:
    """Where tasks are shown; this one shows nothing."""

    def task(
        self,
        name: str,
        total: int | None = None,
        unit: str = "",
        *,
        waiting: Callable[[], int] | None = None,
    ) -> Task:
        """A new task. With `waiting`, `total` is the most that this run will do."""
        return self._task(name, total, unit, waiting)

    def say(self, text: str) -> None:
        """One line."""

    def close(self) -> None:
        """Give the terminal back."""

    def _task(
        self, name: str, total: int | None, unit: str, waiting: Callable[[], int] | None
    ) -> Task:
        return Task()


class Silent(Progress):
    """`--quiet`, and the default in Python code."""


class Counted(Task):
    """What every shown task keeps: how much of what is done, how fast, and the stage's figures.

    May be called from several threads. `_show` is what a display adds.
    """

    def __init__(
        self, name: str, total: int | None, unit: str, waiting: Callable[[], int] | None
    ) -> None:
        self.name, self.unit = name, unit
        self.done, self.total, self.ended = 0, total, False
        self._waiting, self._most = waiting, total
        self._facts: dict[str, object] = {}
        self._lock = threading.RLock()
        self._start = self._counted = self._grown = clock.monotonic()
        self._recount()

    def advance(self, n: int = 1, **facts: object) -> None:
        """Count `n` more items and keep the newest figures."""
        with self._lock:
            self.done += n
            self._facts.update(facts)
            stale = clock.monotonic() - self._counted >= RECOUNT_S or self.done > (self.total or 0)
        if stale:
            self._recount()
        with self._lock:
            self._show()

    def expect(self, more: int) -> None:
        """So many are still to come, as is known by now."""
        with self._lock:
            total = self.done + more
            if self._most is not None:
                total = min(total, self._most)
            if total > (self.total or 0) and self.done:
                self._grown = clock.monotonic()
            self.total = total

    def close(self, *, stopped: bool = False) -> None:
        """No more will come. What never had a total is whole now, unless it was `stopped`."""
        if self.ended:
            return
        self._recount()
        with self._lock:
            self.ended = True
            if self.total is None and not stopped:
                self.total = self.done
            self._end()

    def figures(self) -> str:
        """How much of what is done: "42/60", "42/?" while nobody knows."""
        return f"{self.done:,}/{'?' if self.total is None else f'{self.total:,}'}"

    def rate(self) -> str:
        """Items a second or minute since the start, "" before the first."""
        if not self.done:
            return ""
        speed = self.done / max(clock.monotonic() - self._start, 1e-3)
        return f"{speed:,.1f}/s" if speed >= 1 else f"{speed * 60:,.1f}/min"

    def time_left(self) -> str:
        """How long the rest takes; "" when all is done, or pace and total mean nothing yet."""
        now = clock.monotonic()
        if self.ended or not self.total or not 0 < self.done < self.total:
            return ""
        if now - self._start < SETTLED_S or now - self._grown < SETTLED_S:
            return ""
        return f"{_span((now - self._start) / self.done * (self.total - self.done))} left"

    def facts(self) -> list[str]:
        """The stage's figures in words: a number before its noun, "4 failed"; "quota 21/10,000"."""
        return [
            f"{value:,} {name.replace('_', ' ')}"
            if isinstance(value, (int, float))
            else f"{name.replace('_', ' ')} {value}"
            for name, value in self._facts.items()
        ]

    def _recount(self) -> None:
        """Ask what waits, outside of our lock: the answer may need another one's."""
        if self._waiting is None:
            return
        self._counted = clock.monotonic()
        self.expect(self._waiting())

    def _show(self) -> None:
        """Something has changed."""

    def _end(self) -> None:
        """Nothing will change any more."""


class PlainTask(Counted):
    """A line at most every `every` seconds, and one at the end."""

    def __init__(
        self,
        name: str,
        total: int | None,
        unit: str,
        waiting: Callable[[], int] | None,
        stream: TextIO,
        every: float,
    ) -> None:
        super().__init__(name, total, unit, waiting)
        self._stream, self._every, self._last = stream, every, self._start

    def _show(self) -> None:
        if clock.monotonic() - self._last >= self._every:
            self._print()

    def _end(self) -> None:
        self._print()

    def _print(self) -> None:
        self._last = clock.monotonic()
        count = f"{self.name}: {self.figures()}" + (f" {self.unit}" if self.unit else "")
        parts = [count, self.rate(), self.time_left(), *self.facts()]
        print(terminal.one_line(", ".join(filter(None, parts))), file=self._stream, flush=True)


class LineProgress(Progress):
    """Lines on a stream that is no terminal."""

    def __init__(self, stream: TextIO | None = None, every: float = 10.0) -> None:
        self._stream, self._every = stream or sys.stderr, every

    def say(self, text: str) -> None:
        """One line."""
        print(terminal.one_line(text), file=self._stream, flush=True)

    def _task(
        self, name: str, total: int | None, unit: str, waiting: Callable[[], int] | None
    ) -> Task:
        return PlainTask(name, total, unit, waiting, self._stream, self._every)


def _span(seconds: float) -> str:
    """Seconds as the two largest units, "3h 20m"."""
    minutes, _ = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days}d {hours}h"
    return f"{hours}h {minutes}m" if hours else f"{minutes}m {int(seconds) % 60}s"
