"""Verify (MineDojo paper, datasheet: maintenance): find and repair damaged data.

verify     read every byte of a data root or a release
repair     move damaged data away and fetch it again; rebuild what is made from raw data
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from kb.artifacts.makers import make_artifact
from kb.core.config.pipeline import recipe_of
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.sources import MADE_OF, PUBLISHED, SOURCES
from kb.crawl.job import crawl_source
from kb.crawl.session import open_session
from kb.store.artifact_registry import ARTIFACTS, RELEASE
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
    anew = replace(run, again=True)
    for source in SOURCES:
        yield Crawl(source, partial(_set_aside, run, source), partial(_crawl, run, source))
    for name, artifact in ARTIFACTS.items():
        kind, _, rest = name.partition("/")
        if kind in ("clean", "index", "release", *MADE_OF) and name != RELEASE:
            place, made_again = artifact.folder(run.root), partial(make_artifact, anew, name)
            source = rest if kind == "clean" else ""
            yield Make(kind, artifact.command_again, made_again, (place,), after=source)
    for name in PUBLISHED:
        yield Describe(name, partial(make_artifact, run, RELEASE, {"only": [name]}))


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
    own = recipe_of(run.profile, source).defined("crawl", None)
    return own(run) if own is not None else crawl_source(run, SOURCES[source])
