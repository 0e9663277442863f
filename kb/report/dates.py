"""When the material was made: rows by day, month or year."""

from __future__ import annotations

from kb.core.profile import Profile
from kb.report.charts import over_time
from kb.report.data import ReportData
from kb.report.style import Figure, number, saved


def dates(
    data: ReportData, profile: Profile, table: str, column: str, what: str, color: str
) -> Figure | None:
    """Rows of a table by the time in a column; `what` happened then, in words."""
    timeline = data.timeline(table, column)
    if timeline is None:
        return None
    step, periods = timeline
    source, _, rows = table.partition("/")
    names, values = [name for name, _ in periods], [n for _, n in periods]
    most, n = max(periods, key=lambda period: period[1])
    when = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
    sheet = over_time(names, values, x=f"{step} (UTC)", y=f"{rows} {what}", color=color)
    return Figure(
        f"{source}-dates",
        f"When {rows} were {what}",
        f"{sum(values):,} {rows} by {step}, {when}; most in {most} ({number(n)}).",
        f"Bars of {rows} by the {step} in which they were {what}, {when}; most in {most}, {n:,}.",
        saved(sheet),
        (step, rows),
        periods,
    )
