"""Runs a source: open its data root, discover, work through the phases, return a summary."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from kb.core.context import Run
from kb.core.errors import GLOBAL_STOPS, KbError, LimitReached, NothingRead, Stopped, severity
from kb.core.sources import SourceDeclaration
from kb.core.summary import Summary
from kb.crawl.connector import Answer, Connector, Phase
from kb.crawl.limits import upstream
from kb.crawl.loop import Loop
from kb.crawl.session import CrawlSession, open_session
from kb.net import redact
from kb.store.rawlog.rawlog import SEEDS
from kb.store.state.frontier import Frontier

Summarize = Callable[[CrawlSession, Loop], Summary]


IMPORTED = "imported"  # cursor: the arguments of imports, each a list; `kb update` reads them again
ASKED = "asked"  # cursor: Connector.asked of the newest crawl
STOPPED = "stopped"  # cursor: what a service stopped the newest run for, and what it waits for


def remember_import(frontier: Frontier, **arguments: Sequence[Path | str]) -> None:
    """Note what an import was given, for `kb update`; paths besides those of earlier imports."""
    known = frontier.cursor(IMPORTED, {}, of=dict[str, list[str]])
    for name, values in arguments.items():
        texts = [str(value.absolute()) if isinstance(value, Path) else value for value in values]
        paths = any(isinstance(value, Path) for value in values)
        known[name] = list(dict.fromkeys([*known.get(name, ()), *texts])) if paths else texts
    frontier.set_cursor(IMPORTED, known)


def work(
    run: Run,
    connector: Connector,
    summarize: Summarize,
    *,
    phases: Sequence[Phase] | None = None,
    place: Path | None = None,
    facts: Callable[[Phase], dict[str, object]] | None = None,
    removed: Collection[str] = (),
) -> Summary:
    """Run `phases` (by default all of the source) until nothing is left. Returns the summary.

    Items that failed in an earlier run are retried once; `removed` keys count as purged. Raises
    what `Loop.run` and `check_read` raise, always with the summary so far on the error.
    """
    with open_session(run, connector, place, removed=removed) as session:
        if connector.asked is not None:
            session.frontier.set_cursor(ASKED, dict(connector.asked))
        loop = Loop(session, phases, facts=facts)
        try:
            for params in connector.seeds(session.frontier):
                session.record(Answer(SEEDS, SEEDS, params, {}))
            connector.discover(session.frontier)
            loop.run()
            check_read(connector, loop)
        except KbError as error:
            error.summary = summarize(session, loop)
            if isinstance(error, Stopped) and not isinstance(error, (LimitReached, *GLOBAL_STOPS)):
                note = {"stopped": redact.text(str(error)), "waits_for": error.waits_for}
                session.frontier.set_cursor(STOPPED, note)
            raise
        session.frontier.set_cursor(STOPPED, None)
        return summarize(session, loop)


def crawl_source(
    run: Run,
    source: SourceDeclaration,
    connector: Connector,
    command: str,
    only: Sequence[str] = (),
    **options: Any,
) -> Summary:
    """Crawl a source that needs no summary of its own, or `only` some kinds; `options` and errors
    are those of `work`.
    """
    kinds = [phase.kind for phase in connector.phases]
    counted = [kind for kind, noun in source.nouns.items() if noun == source.counted]

    def summary(session: CrawlSession, loop: Loop) -> Summary:
        counts = {kind: session.frontier.counts(kind) for kind in kinds}
        left = source.left_by(counts)
        skipped = (item for kind in counted for item in session.frontier.items(kind, "skipped"))
        return Summary(
            command=command,
            source=source.name,
            counted=source.counted,
            crawled=sum(loop.answered[kind] for kind in counted),
            crawled_in_all=sum(counts[kind].get("done", 0) for kind in counted),
            missing=sum(why == "not_found" for _, _, why, _ in skipped),
            failed=sum(answers.get("error", 0) for answers in counts.values()),
            pending=session.frontier.waiting(*counted),
            requests=session.requests()[0],
            units=session.requests()[1],
            left=sum(left.values()),
            left_by=left,
        )

    phases = [phase for phase in connector.phases if phase.kind in (only or kinds)]
    return work(run, connector, summary, phases=phases, **options)


def check_read(connector: Connector, loop: Loop) -> None:
    """Raises NothingRead when a run read none of the items it counts because every item of a
    phase before them failed.

    Items that fail again after others were read in earlier runs do not count.
    """
    phases = loop.scheduler.phases
    counted = {phase.kind for phase in phases if phase.limited}
    if any(loop.tried[kind].n_read for kind in counted):
        return
    for phase in phases:
        if phase.kind not in counted.union(*(upstream(phases, kind) for kind in counted)):
            continue
        tried = loop.tried[phase.kind]
        unread = tried.failed + (tried.skipped if phase.kind in counted else Counter())
        if not tried.n or unread.total() < tried.n:
            continue
        news = tried.first and tried.failed
        if not news and loop.scheduler.answered(phase.service, phase) is not None:
            continue
        ((reason, n),) = unread.most_common(1)
        raise NothingRead(
            f"none of {tried.n:,} {phase.unit} could be read; the most frequent reason is"
            f" {reason} ({n:,} of {tried.n:,})",
            hint=connector.advice(phase, reason),
        )


class Parts:
    """Runs the jobs of one command: a stopped job does not prevent the next ones.

    Adds up the numbers `added` of their summaries (the first three even if zero) and copies their
    `rows`.
    """

    added = ("requests", "units", "failed", "left", "bad_lines", "truncated_files")

    def __init__(self, command: str, rows: Sequence[str]) -> None:
        self.summary = Summary(command=command, **dict.fromkeys(self.added[:3], 0))
        self._rows = rows
        self._stopped: list[NothingRead | Stopped] = []

    def take(self, job: Callable[..., Summary], *args: Any, **options: Any) -> None:
        """Run one job. Raises what `job` raises, but NothingRead and stops of its own service only
        at the end.
        """
        done: Mapping[str, Any]
        ended = False
        try:
            done = job(*args, **options)
        except (NothingRead, Stopped) as error:
            done = error.summary or {}
            self._stopped.append(error)
            ended = isinstance(error, GLOBAL_STOPS)
        for name in self.added:
            if done.get(name):
                self.summary[name] = self.summary.get(name, 0) + done[name]
        self.summary |= {name: done[name] for name in self._rows if name in done}
        if ended:
            self.finish()

    def finish(self) -> Summary:
        """The summary of all jobs. Raises the worst NothingRead or Stopped with that summary."""
        if self._stopped:
            worst = min(self._stopped, key=severity)
            worst.summary = self.summary
            raise worst
        return self.summary
