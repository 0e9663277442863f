"""Progress on stderr: bars on a terminal, plain lines elsewhere, nothing with --quiet."""

import sys
from collections.abc import Callable
from typing import Any

from kb.cli.framework.messages import with_options
from kb.core import terminal
from kb.core.progress import Counted, LineProgress, Progress, Silent, Task


def choose(*, quiet: bool) -> Progress:
    """The display that fits where stderr goes."""
    if quiet:
        return Silent()
    return Bars() if sys.stderr.isatty() else Lines()


class Lines(LineProgress):
    """Plain lines, in which commands are completed with --data and --profile."""

    def say(self, text: str) -> None:
        """One line."""
        super().say(with_options(text))


class Bars(Progress):
    """One bar per task: done and total, rate, time left, and the stage's own figures."""

    def __init__(self) -> None:
        self._live: Any = None

    def say(self, text: str) -> None:
        """One line above the bars."""
        shown = terminal.one_line(with_options(text))
        if self._live is not None:
            self._live.console.print(shown, highlight=False, markup=False)
        else:
            print(shown, file=sys.stderr, flush=True)

    def _task(
        self, name: str, total: int | None, unit: str, waiting: Callable[[], int] | None
    ) -> Task:
        return BarTask(self._start(), name, total, unit, waiting)

    def close(self) -> None:
        """Stop updating the bars, and release the terminal."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _start(self) -> Any:
        if self._live is None:
            from rich import progress as rich
            from rich.console import Console

            self._live = rich.Progress(
                rich.TextColumn("{task.description}", markup=False),
                rich.BarColumn(bar_width=24),
                rich.TextColumn("{task.fields[figures]}", markup=False),
                rich.TextColumn("{task.fields[facts]}", markup=False, style="dim"),
                console=Console(stderr=True),
                refresh_per_second=4,
            )
            self._live.start()
        return self._live


class BarTask(Counted):
    """A bar of the live display."""

    def __init__(
        self,
        live: Any,
        name: str,
        total: int | None,
        unit: str,
        waiting: Callable[[], int] | None,
    ) -> None:
        super().__init__(name, total, unit, waiting)
        self._live = live
        self._number = live.add_task(
            terminal.one_line(name), total=self.total, figures="", facts=""
        )
        self._show()

    def _show(self) -> None:
        figures = f"{self.figures()} {self.unit}".rstrip()
        self._live.update(
            self._number,
            completed=self.done,
            figures="  ".join(filter(None, (figures, self.rate(), self.time_left()))),
            facts=terminal.one_line("  ".join(self.facts())),
            **({} if self.total is None else {"total": self.total}),
        )

    def _end(self) -> None:
        self._show()
        self._live.stop_task(self._number)
