"""How progress is shown: bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from typing import Any

from kb.cli.framework.messages import with_options
from kb.core import terminal
from kb.core.progress import LineProgress, Progress, Task


def choose_progress(*, quiet: bool) -> Progress:
    """Bars on a terminal, plain lines elsewhere, nothing with --quiet."""
    if quiet:
        return Progress()
    return Bars() if sys.stderr.isatty() else LineProgress(complete=with_options)


class Bars(Progress):
    """One bar per task: done and total, rate, time left, and the stage's own figures."""

    def __init__(self) -> None:
        self._live: Any = None
        self._bars: dict[Task, Any] = {}

    def say(self, text: str) -> None:
        """Print one line above the bars."""
        super().say(text)
        shown = terminal.one_line(with_options(text))
        if self._live is not None:
            self._live.console.print(shown, highlight=False, markup=False)
        else:
            print(shown, file=sys.stderr, flush=True)

    def show(self, task: Task) -> None:
        """Draw a task's bar."""
        if self._live is None:
            self._live = _live_bars()
        if task not in self._bars:
            self._bars[task] = self._live.add_task(
                terminal.one_line(task.name), total=task.total, figures="", facts=""
            )
        self._live.update(
            self._bars[task],
            completed=task.done,
            figures="  ".join(task.figures()),
            facts=terminal.one_line("  ".join(task.facts())),
            **({} if task.total is None else {"total": task.total}),
        )
        if task.ended:
            self._live.stop_task(self._bars.pop(task))

    def close(self) -> None:
        """Stop updating the bars, and release the terminal."""
        if self._live is not None:
            self._live.stop()
            self._live = None


def _live_bars() -> Any:
    from rich import progress as rich
    from rich.console import Console

    live = rich.Progress(
        rich.TextColumn("{task.description}", markup=False),
        rich.BarColumn(bar_width=24),
        rich.TextColumn("{task.fields[figures]}", markup=False),
        rich.TextColumn("{task.fields[facts]}", markup=False, style="dim"),
        console=Console(stderr=True),
        refresh_per_second=4,
    )
    live.start()
    return live
