"""Progress of long work: what a stage reports, however it is shown.

waiting = lambda: frontier.waiting("videos")
with run.progress.task("metadata", unit="videos", waiting=waiting) as task:
    task.advance(50, quota="21/10,000")

The total is what is known now: given once, or what is done and what `waiting` says; it grows as
discovery finds more. A task that an error ends stays as it is, partial.
"""

import logging
import sys
import threading
from collections.abc import Callable
from typing import Self, TextIO

from kb.core import clock, terminal

RECOUNT_S = 0.5  # how often `waiting` is asked: it may read a large state
SETTLED_S = 5.0  # before that, and that long after the total grew, the time left would be a guess
RATE_S = 1.0  # before that a rate says how fast a machine counts
LOG_S = 600.0  # how often the log has a line of a task that goes on

EVENTS = logging.getLogger("kb.events")
"""What the log of a command holds and the terminal shows otherwise (kb.core.run_log)."""
EVENTS.propagate = False
EVENTS.setLevel(logging.INFO)
EVENTS.addHandler(logging.NullHandler())


def note_event(text: str, level: int = logging.INFO) -> None:
    """One line of the log."""
    EVENTS.log(level, "%s", terminal.one_line(text))


class Task:
    """What is done of how much, how fast, and the stage's newest figures.

    May be called from several threads. As a context manager it knows whether an error ended it.
    `show` is called with the task when something has changed; without it, nothing is shown.
    """

    def __init__(
        self,
        name: str = "",
        total: int | None = None,
        unit: str = "",
        waiting: Callable[[], int] | None = None,
        show: Callable[["Task"], None] | None = None,
    ) -> None:
        self.name, self.unit = name, unit
        self.done, self.total, self.ended = 0, total, False
        self._waiting, self._show, self._most = waiting if show else None, show, total
        self._facts: dict[str, object] = {}
        self._lock = threading.RLock()
        self.start = self._counted = self._grown = self._logged = clock.monotonic()
        self._recount()
        self._changed()

    def advance(self, n: int = 1, **facts: object) -> None:
        """Count `n` more items and keep the newest figures."""
        with self._lock:
            self.done += n
            self._facts.update(facts)
            stale = clock.monotonic() - self._counted >= RECOUNT_S or self.done > (self.total or 0)
        if stale:
            self._recount()
        self._changed()

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
        self.ended = True
        if self.total is None and not stopped:
            self.total = self.done
        self._changed()
        if self.name and (self.done or self.total):
            note_event(self.line())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self.close(stopped=kind is not None)

    def figures(self) -> list[str]:
        """In words: "42/60 videos" ("42/?" while the total is unknown), a rate, the time left."""
        elapsed = clock.monotonic() - self.start
        total = "?" if self.total is None else f"{self.total:,}"
        words = [f"{self.done:,}/{total} {self.unit}".rstrip()]
        if self.done and elapsed >= RATE_S:
            speed = self.done / elapsed
            words.append(f"{speed:,.1f}/s" if speed >= 1 else f"{speed * 60:,.1f}/min")
        since = min(elapsed, clock.monotonic() - self._grown)
        if not self.ended and 0 < self.done < (self.total or 0) and since >= SETTLED_S:
            words.append(f"{span(elapsed / self.done * ((self.total or 0) - self.done))} left")
        return words

    def facts(self) -> list[str]:
        """The stage's figures in words: a number before its noun, "4 failed"; "quota 21/10,000"."""
        words = {name.replace("_", " "): value for name, value in self._facts.items()}
        return [
            f"{value:,} {name}" if isinstance(value, (int, float)) else f"{name} {value}"
            for name, value in words.items()
        ]

    def line(self) -> str:
        """Name, figures and facts in one line."""
        first, *rest = (*self.figures(), *self.facts())
        return ", ".join([f"{self.name}: {first}", *rest])

    def _recount(self) -> None:
        """Ask what waits, outside of our lock: the answer may need another one's."""
        if self._waiting is not None:
            self._counted = clock.monotonic()
            self.expect(self._waiting())

    def _changed(self) -> None:
        if clock.monotonic() - self._logged >= LOG_S and not self.ended:
            self._logged = clock.monotonic()
            note_event(self.line())
        if self._show is not None:
            with self._lock:
                self._show(self)


class Progress:
    """Where tasks are shown; this one shows nothing: `--quiet`, and the default in Python code."""

    show: Callable[[Task], None] | None = None

    def task(
        self,
        name: str,
        total: int | None = None,
        unit: str = "",
        *,
        waiting: Callable[[], int] | None = None,
    ) -> Task:
        """A new task. With `waiting`, `total` is the most that this run will do."""
        return Task(name, total, unit, waiting, self.show)

    def say(self, text: str) -> None:
        """Show one line, here only in the log."""
        note_event(text)

    def close(self) -> None:
        """Give the terminal back."""


class LineProgress(Progress):
    """Lines on a stream that is no terminal: for a task one at most every `every` seconds, and one
    at the end. `complete` finishes a line of `say`.
    """

    def __init__(
        self,
        stream: TextIO | None = None,
        every: float = 10.0,
        complete: Callable[[str], str] = str,
    ) -> None:
        self._stream, self._every, self._complete = stream or sys.stderr, every, complete
        self._printed: dict[Task, float] = {}

    def say(self, text: str) -> None:
        """Print one line."""
        super().say(text)
        print(terminal.one_line(self._complete(text)), file=self._stream, flush=True)

    def show(self, task: Task) -> None:
        """Print a task's figures when it is time to."""
        now = clock.monotonic()
        if task.ended:
            self._printed.pop(task, None)
            if not task.done and not task.total:
                return  # there was nothing to do
        elif now - self._printed.get(task, task.start) < self._every:
            return
        else:
            self._printed[task] = now
        print(terminal.one_line(task.line()), file=self._stream, flush=True)


def span(seconds: float) -> str:
    """Seconds as the two largest units, "3h 20m"."""
    minutes, _ = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    if days:
        return f"{days}d {hours}h"
    return f"{hours}h {minutes}m" if hours else f"{minutes}m {int(seconds) % 60}s"
