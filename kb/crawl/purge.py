"""The first part of a purge, which needs a source's raw answers and state under its lock."""

from __future__ import annotations

from kb.artifacts import purge as steps
from kb.artifacts import purge_raw
from kb.artifacts.purge import Purge, PurgeList, PurgeRules
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.crawl.session import open_session
from kb.store.layout import Layout


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
        try:
            purge_raw.check_readable(run.root, rules.source, run.workers)
        except DamagedData:
            session.recorder.look_into_all()
        purge.find()
        purge.begin()
        if purge.keys:
            list(steps.answers(purge))
            list(steps.state(purge))
        return purge
