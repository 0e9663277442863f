"""What the recipe of a source does unless it says otherwise; it declares how raw answers are judged
(`clean`).

    tables     raw/<source> → clean/<source>
    export     clean/<source> → release/<source>, or export/<format>/
"""

from typing import Any

from kb.core.context import Run
from kb.core.summary import Summary
from kb.crawl.session import replay_unread_answers
from kb.export import layouts
from kb.filters.filter_run import check_kept, check_scorer, run_clean
from kb.registry import PUBLISHED, SOURCES


def tables_needs(run: Run, source: str) -> None:
    """Raises UsageError without the model that scores texts."""
    check_scorer(run, source)


def tables(run: Run, source: str) -> Summary:
    """Judge the raw answers. What the crawl gave up on only the state says."""
    check_scorer(run, source)  # before anything is written
    replay_unread_answers(run, source, SOURCES[source].connector)
    return check_kept(run, source, run_clean(run, source))


def export(run: Run, source: str, format: str = "parquet", **options: Any) -> Summary:
    """Write the kept rows in a layout."""
    return layouts.export(run, PUBLISHED[source], format, **options)
