"""Verify (MineDojo paper, datasheet: maintenance): find and repair damaged data.

verify     read every byte of a data root or a release
repair     move damaged data away and fetch it again; rebuild what is made from raw data
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from kb.artifacts.resumable_build import clear_finished
from kb.core.config.pipeline import load, locate
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import PUBLISHED, SOURCES, exported_by
from kb.crawl.job import crawl_source
from kb.crawl.session import open_session
from kb.export import layouts
from kb.filters.filter_run import run_clean
from kb.pairs.build import build
from kb.release.build import release
from kb.search.build import follow
from kb.store.layout import Layout
from kb.store.rawlog import damaged_answers
from kb.verify.findings import Findings
from kb.verify.repair import Crawl, Describe, Make, Step, repaired
from kb.verify.root import verify as look_at


def verify(run: Run, folder: Path) -> Findings:
    """Read everything; change nothing."""
    return look_at(folder, run.progress)


def repair(run: Run) -> tuple[Findings, list[str]]:
    """The problems that remain after repair, and one line for each repair."""
    return repaired(run.root, run.progress, steps(run))


def steps(run: Run) -> Iterator[Step]:
    """Everything that can be rebuilt, in the order of the data; each step checks whether to."""
    at, anew = Layout(run.root), replace(run, again=True)
    for source in SOURCES:
        yield Crawl(source, partial(_set_aside, run, source), partial(_crawl, run, source))
        clean = partial(run_clean, run, source)
        yield Make("clean", f"kb {source} filter", clean, (at.clean(source),), after=source)
    yield Make("pairs", "kb pairs --again", partial(build, anew), (at.pairs,))
    clear_finished(run.root, "pairs")
    tasks = partial(load(str(locate("tasks"))).tables, anew)
    yield Make("tasks", "kb tasks --again", tasks, (at.tasks,))
    links = partial(load(str(locate("links"))).tables, anew)
    yield Make("links", "kb links --again", links, (at.links,))
    for source in SOURCES:
        step = partial(follow, anew, source)
        yield Make("index", "kb index --again", step, (at.index(source),))
    for name in PUBLISHED:
        export = partial(layouts.export, run, name)
        yield Make("release", exported_by(name), export, (at.release(name),))
        yield Describe(name, partial(release, run, [name]))


def _set_aside(run: Run, source: str) -> list[str]:
    """Move damaged parts of raw data away, and mark their items to be fetched again."""
    try:
        connector = SOURCES[source].connector(run)
        with open_session(run, connector, online=False, report_damage=False) as session:
            session.recorder.check_all_segments()
            damaged_answers.report(run.root, source, session.frontier)
    except DamagedData as error:
        return [f"{error}; {error.hint}"]
    return []


def _crawl(run: Run, source: str) -> object:
    own = getattr(load(str(locate(source))), "crawl", None)
    return own(run) if own is not None else crawl_source(run, SOURCES[source])
