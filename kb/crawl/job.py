"""A whole run of a source: open its data root, discover, work through the phases,
tell what was done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from kb.core.context import Run
from kb.core.errors import KbError
from kb.core.verdict import Summary
from kb.crawl.loop import Loop
from kb.crawl.session import Session, open_session
from kb.crawl.source import Phase, Source

Summarize = Callable[[Session, Loop], Summary]


def work(
    run: Run,
    source: Source,
    summarize: Summarize,
    *,
    phases: Sequence[Phase] | None = None,
    place: Path | None = None,
    facts: Callable[[Phase], dict[str, object]] | None = None,
) -> Summary:
    """Run `phases` (all of the source's by default) until nothing is left; what was done.

    What failed in an earlier run is tried again once. Raises what `Loop.run` raises, always with
    the summary so far on the error.
    """
    with open_session(run, source, place) as session:
        loop = Loop(session, phases, facts=facts)
        try:
            for phase in loop.phases:
                session.frontier.reopen(phase.kind, "error")
            source.discover(session.frontier)
            loop.run()
        except KbError as error:
            error.summary = summarize(session, loop)
            raise
        return summarize(session, loop)
