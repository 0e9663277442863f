"""Progress on stderr: bars on a terminal, plain lines elsewhere, nothing with --quiet."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kb.core.progress import Progress, Task


def choose(*, quiet: bool) -> Progress:
    """The display that fits where stderr goes."""
    from kb.core.progress import Plain, Silent

    if quiet:
        return Silent()
    return Bars() if sys.stderr.isatty() else Plain()


class Bars:
    """One bar a task: done and total, rate, time left, and the figures that the stage names (quota, units)."""

    def __init__(self) -> None:
        self._live: Any = None

    def task(self, name: str, total: int | None = None, unit: str = "") -> Task:
        """A new bar; the display starts with the first one."""
        live = self._start()
        return BarTask(live, live.add_task(name, total=total, unit=unit, facts="", rate=""))

    def say(self, text: str) -> None:
        """One line above the bars."""
        from kb.core import terminal

        shown = terminal.one_line(text)
        if self._live is not None:
            self._live.console.print(shown, highlight=False, markup=False)
        else:
            print(shown, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the bars as they are and give the terminal back."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _start(self) -> Any:
        if self._live is None:
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                Progress,
                TextColumn,
                TimeRemainingColumn,
            )

            self._live = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=24),
                MofNCompleteColumn(),
                TextColumn("{task.fields[unit]} {task.fields[rate]}", markup=False),
                TimeRemainingColumn(compact=True),
                TextColumn("{task.fields[facts]}", markup=False, style="dim"),
                console=Console(stderr=True),
                refresh_per_second=4,
            )
            self._live.start()
        return self._live


class BarTask:
    """A bar of the live display."""

    def __init__(self, live: Any, number: Any) -> None:
        self._live, self._number = live, number
        self._facts: dict[str, object] = {}

    def advance(self, n: int = 1, **facts: object) -> None:
        """Count `n` more items and keep the newest figures."""
        self._facts.update(facts)
        shown = "  ".join(
            f"{name.replace('_', ' ')} {value}" for name, value in self._facts.items()
        )
        self._live.update(self._number, advance=n, facts=shown, rate=self._rate())

    def close(self) -> None:
        """Nothing more will come: a task without a known total is whole now."""
        task = self._find()
        if task is not None and task.total is None:
            self._live.update(self._number, total=task.completed)
        self._live.stop_task(self._number)

    def _rate(self) -> str:
        task = self._find()
        speed = task.speed if task is not None else None
        if not speed:
            return ""
        return f"{speed:,.1f}/s" if speed >= 1 else f"{speed * 60:,.1f}/min"

    def _find(self) -> Any:
        return next((task for task in self._live.tasks if task.id == self._number), None)
