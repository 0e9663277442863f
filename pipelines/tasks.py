"""Tasks (MineDojo paper, benchmark appendix: creative tasks mined from YouTube; 1,042 there).

The titles of kept videos that say what is done become prompts. Chapters in the description, or the
transcript, say when the task begins and ends.

    build      titles → tasks/tasks-*.parquet; those that give none → tasks/titles-*.parquet
    release    tasks/ → release/tasks/
    layouts    tasks/ → export/<format>/
"""

from kb.artifacts import domain_binding
from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.store.layout import Layout
from kb.tasks.build import build, check
from kb.youtube.ytdlp.info import playlists


def tasks(run: Run, layout: str) -> Summary:
    """Make the tasks, then write them in the given layout."""
    check(run)
    with domain_binding.writing(run, "tasks", "release-tasks"):
        made = tables(run)
        written = layouts.export(run, "tasks", layout)
    if layout == "parquet":
        written = Summary(release=str(Layout(run.root).release("tasks")))
    return Summary(made, **written)


def tables(run: Run) -> Summary:
    """Make the tasks."""
    return build(run, playlists(run.root))


def rebuild(run: Run) -> None:
    """Rebuild existing tasks and all that is made of them; delete what can't be rebuilt."""
    layouts.rebuild(run, "tasks", "tasks", tables)
