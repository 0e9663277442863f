"""The first part of a purge, which needs a source's raw answers and state under its lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from kb.artifacts import purge as steps
from kb.artifacts.purge import Purge, PurgeList, PurgeRules
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.crawl.session import CrawlSession, open_session
from kb.store.layout import Layout

T = TypeVar("T")


def purge_answers(run: Run, rules: PurgeRules, listed: PurgeList | None) -> Purge:
    """Take keys out of raw answers and the state; the purge, whose other steps come next.

    Damaged raw data is set aside; `steps.finish` reports it. Raises WriterLocked, DiskFull,
    Interrupted.
    """
    # Opening a session takes in what a killed crawl or import had not committed.
    with open_session(run, steps.connector(rules.source)(run), asks=False, tells=False) as session:
        session.recorder.close()
        scratch = Layout(run.root).known(rules.source)
        purge = Purge(run, rules, listed, session.frontier, scratch)
        _repaired(session, purge.find)
        _repaired(session, purge.begin)
        _repaired(session, lambda: list(steps.answers(purge)))
        if purge.keys:
            list(steps.state(purge))
        return purge


def _repaired(session: CrawlSession, read: Callable[[], T]) -> T:
    """What `read` returns; if it meets damaged raw data, that is set aside first."""
    try:
        return read()
    except DamagedData as error:
        if getattr(error, "path", None) is None:
            raise
        session.recorder.look_into_all()
        return read()
