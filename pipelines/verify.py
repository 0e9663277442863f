"""Verify (MineDojo paper, datasheet: maintenance): find damaged data, and make a whole data root of
what is intact.

verify     read every byte of a data root or a release
repair     set damage aside, replay states from raw answers, make derived data again; send nothing
"""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from kb.artifacts import freshness, manifest
from kb.artifacts.makers import MADE, STOPPED, make_outdated
from kb.core.context import Run
from kb.core.errors import DamagedData, DiskFull, Interrupted, KbError
from kb.core.sources import PUBLISHED
from kb.crawl.session import open_session
from kb.registry import SOURCES
from kb.store import lock
from kb.store.artifact_registry import ARTIFACTS, RELEASE
from kb.store.layout import CAPTURED, Layout
from kb.store.rawlog import sidefiles
from kb.store.state.frontier import Frontier
from kb.verify.findings import Findings
from kb.verify.repair import damaged_artifacts, lost_sources, set_aside
from kb.verify.root import verify as look_at


def verify(run: Run, folder: Path) -> Findings:
    """Read everything; change nothing."""
    return look_at(folder, run.progress)


def repair(run: Run) -> tuple[Findings, list[str]]:
    """The problems that remain after a repair, and what was done and is left to do, a line each.

    Raises WriterLocked, DiskFull, Interrupted.
    """
    with lock.taking(run.root, *lock.ORDER):  # which clears what killed commands left
        findings = look_at(run.root, run.progress)
        lines = set_aside(run.root, findings)
        for source in lost_sources(run.root, findings):
            lines += _replay(run, source)
        lines += _make_again(run, findings)
        left = look_at(run.root, run.progress) if findings.entries else findings
        if captured := sidefiles.suspects(run.root):
            lines.append(f"`kb {CAPTURED} crawl` fetches {len(captured):,} captured files again")
        return left, [*lines, *_refused(run)]


def _replay(run: Run, source: str) -> Iterator[str]:
    """Set damaged frames aside, and replay the state from the others."""
    state = Layout(run.root).state(source)
    damaged = sidefiles.quarantine_path(state)
    try:
        connector = SOURCES[source].connector(run)
        with open_session(run, connector, online=False, report_damage=False) as session:
            session.recorder.check_all_segments()
            if (damage := session.recorder.damage) is not None:
                yield f"{damage}; {damage.hint}"
            if damaged.is_file() and not session.frontier.requests()[0]:
                yield _take_over_ledger(session.frontier, damaged)
    except (DiskFull, Interrupted):
        raise
    except KbError as error:
        yield f"{state} was not replayed: {error}; {error.hint}"


def _take_over_ledger(frontier: Frontier, damaged: Path) -> str:
    """What no raw answer says: the requests that were sent."""
    try:
        with closing(Frontier(damaged, readonly=True)) as earlier:
            return f"{frontier.add_ledger(earlier):,} requests of {damaged} are in the ledger again"
    except DamagedData:
        return f"what was spent can't be read from {damaged}: a quota may be used up sooner"


def _make_again(run: Run, findings: Findings) -> Iterator[str]:
    damaged = damaged_artifacts(run.root, findings)
    for name, foreign in damaged.items():
        if foreign is not None:
            yield f"{name} was left: move {foreign} away, then run `kb build`"
    names = [name for name, foreign in damaged.items() if foreign is None]
    if manifest.read_manifest(run.root, RELEASE) is not None and RELEASE not in names:
        names.append(RELEASE)
    for done in make_outdated(run, freshness.plan(run, names)):
        if done.outcome == STOPPED and done.error is not None:  # a full disk, a signal
            raise done.error
        made = f"{done.artifact} was made again"
        yield made if done.outcome == MADE else f"{done.artifact}: {done}"


def _refused(run: Run) -> Iterator[str]:
    """Why a release would be refused."""
    names = [f"release/{name}" for name in PUBLISHED]
    there = [name for name in names if ARTIFACTS[name].folder(run.root).is_dir()]
    for line in freshness.lines(freshness.stale(run, *there)):
        yield f"a release is refused: {line} (out of date)"
