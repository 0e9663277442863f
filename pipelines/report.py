"""Report: figures and one page of what was collected (MineDojo paper, appendix "Datasheet":
composition).
"""

from pathlib import Path

from kb.core.context import Run
from kb.core.summary import Summary
from kb.registry import PUBLISHED
from kb.report import build


def report_needs(run: Run) -> None:
    """Raises UsageError without the extra that draws."""
    build.check_extra()


def report(run: Run, out: Path | None = None, figures: bool = False) -> Summary:
    """clean/, pairs/, tasks/ and links/ → report/, or `out`, with PDFs and clouds if `figures`."""
    return build.report(run, PUBLISHED, out, figures)
