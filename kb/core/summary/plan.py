"""What a command would cost, before anything is sent: one table by phase, the same for all of them.

return Summary(plan("refresh youtube", "youtube", [Phase("videos", 278, requests=6, units=6)]))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from kb.core import terminal
from kb.core.summary import phrases

_MORE = ("days", "searches_left_today", "units_left_today")
_COLUMNS = ("items", "requests", "units", "hours", "gb")


class PlanPhase(NamedTuple):
    """One line: what is done to how many items, and what it takes. `gb` of raw data on disk."""

    phase: str
    items: int
    requests: int = 0
    units: int = 0
    hours: float = 0.0
    gb: float = 0.0

    def asking(self, whom: str) -> PlanPhase:
        """The same phase, with whom it asks."""
        return self._replace(phase=f"{self.phase} of {whom}")


class PlanPart(NamedTuple):
    """What one source adds to a plan of several."""

    phases: Sequence[PlanPhase] = ()
    assumed: Sequence[str] = ()


def join(command: str, parts: Sequence[PlanPart]) -> dict[str, Any]:
    """One plan of all parts, in their order, without phases that have nothing left to do."""
    phases = [phase for part in parts for phase in part.phases if phase.items]
    return plan(command, "", phases, [assumption for part in parts for assumption in part.assumed])


def plan(
    command: str, source: str, phases: Sequence[PlanPhase], assumed: Sequence[str] = (), **more: Any
) -> dict[str, Any]:
    """A plan's summary: sums over the phases, `more`, the phases, and what was assumed."""
    sums = {name: round(sum(getattr(phase, name) for phase in phases), 3) for name in _COLUMNS[1:]}
    rows = [
        {**phase._asdict(), "hours": round(phase.hours, 2), "gb": round(phase.gb, 3)}
        for phase in phases
    ]
    assumptions = ", ".join(assumed) or None
    head = {"command": f"{command} --plan", "source": source}
    return {**head, **sums, **more, "phases": rows, "assumed": assumptions}


def table(summary: Mapping[str, Any]) -> str:
    """A plan for a person: a line a phase, the sums, and what was assumed."""
    rows = list(summary["phases"])
    sums = {name: sum(row[name] for row in rows) for name in _COLUMNS if name != "items"}
    if not rows:
        return f"{summary['command']}: nothing is left to do"
    lines = [f"{summary['command']}: nothing is sent"]
    cells = [("phase", *_COLUMNS)]
    for row in (*rows, {"phase": "all", "items": "", **sums}):
        cells.append((row["phase"], *(_cell(name, row[name]) for name in _COLUMNS)))
    lines += [f"  {line}" for line in terminal.table(cells, 10)]
    more = [phrases.phrase(name, summary.get(name), dict(summary)) for name in _MORE]
    if any(more):
        lines.append("  " + ", ".join(filter(None, more)))
    if summary.get("assumed"):
        lines.append(f"  assumed: {summary['assumed']}")
    return "\n".join(map(terminal.one_line, lines))


def _cell(name: str, value: Any) -> str:
    if value == "":
        return ""
    return f"{value:,.1f}" if name == "hours" else f"{value:,.3g}" if name == "gb" else f"{value:,}"


# Of a plan for a new round; what is new there comes on top.
NOTHING_NEW = "nothing is new since the last round"


def to_read(kinds: Mapping[str, Mapping[str, int]], kind: str) -> int:
    """How many items the next crawl would fetch: those that wait, and those that failed."""
    counts = kinds.get(kind, {})
    return sum(counts.get(status, 0) for status in ("todo", "in_progress", "error"))
