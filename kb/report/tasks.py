"""The figure of tasks."""

from kb.core.config.profile import Profile
from kb.report.data import ReportData
from kb.report.figure_style import (
    GREEN,
    Figure,
    readable,
)
from kb.report.figures import bar_figure


def titles(data: ReportData, profile: Profile) -> Figure | None:
    """What becomes of the titles: tasks by where their times come from, and reasons for none."""
    times = data.rows(
        "tasks/tasks", "SELECT 'task: ' || start_source, count(*) FROM {t} GROUP BY 1"
    )
    none = data.rows("tasks/titles", "SELECT rejected_reason, count(*) FROM {t} GROUP BY 1")
    rows = [*sorted(times), *sorted(none, key=lambda row: (-row[1], row[0]))]
    if not rows:
        return None
    tasks, total = sum(n for _, n in times), sum(n for _, n in rows)
    return bar_figure(
        "tasks-titles",
        "Which titles give a task",
        f"{tasks:,} tasks of {total:,} titles, by what says when they begin; the others by reason.",
        rows,
        head=("title", "titles"),
        labels=[readable(name) for name, _ in rows],
        colors=GREEN,
    )
