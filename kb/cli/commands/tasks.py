"""`kb tasks`: what titles of kept videos say that is done in them, as prompts."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import pipeline
from kb.core.context import Run
from kb.core.summary import Summary

app = group("Mine candidates for creative tasks from titles of videos.")


class TasksFormat(StrEnum):
    """Layouts of tasks."""

    parquet = "parquet"
    minedojo = "minedojo"


@command(
    app,
    uses=("pipeline",),
    again="Mine all titles again, even if nothing has changed.",
    json="tasks, titles, starts, rejected_by",
    needs_data=True,
    checks=True,
    examples=[
        "kb tasks                                 prompts with times, in tasks/ and release/tasks/",
        "kb tasks --format minedojo               export/minedojo/creative_tasks.yaml",
        'kb query "FROM tasks_titles SELECT rejected_reason, count(*) GROUP BY ALL"',
    ],
)
def tasks(
    run: Run,
    format: Annotated[
        TasksFormat,
        typer.Option("--format", help="Parquet goes to release/, other formats to export/FORMAT/."),
    ] = TasksFormat.parquet,
) -> Summary:
    """Mine tasks from titles: "How to Build an EASY Iron Farm!" is "build an easy iron farm".

    Each video gives at most one task, which begins where a chapter or the transcript first names
    its object. Every title that gives none is in tasks_titles with the reason. The verbs and
    phrases are those of [tasks] in the profile.
    """
    summary: Summary = pipeline(run, "tasks").tasks(run, format.value)
    return summary
