"""Tasks (MineDojo paper, benchmark appendix: creative tasks mined from YouTube; 1,042 there).

The titles of kept videos that say what is done become prompts. Chapters in the description, or the
transcript, say when the task begins and ends.

    tables     titles → tasks/tasks-*.parquet; those that give none → tasks/titles-*.parquet
    export     tasks/ → release/tasks/, or export/<format>/
"""

from kb.core.context import Run
from kb.core.summary import Summary
from kb.export import layouts
from kb.labels.imports import measure_labels
from kb.registry import PUBLISHED
from kb.tasks.build import build


def tables(run: Run) -> Summary:
    """Make the tasks, and count what was judged of them."""
    made = build(run)
    measure_labels(run)
    return made


def export(run: Run, format: str = "parquet") -> Summary:
    """tasks/ to release/tasks, or to export/<format>."""
    return layouts.export(run, PUBLISHED["tasks"], format)
