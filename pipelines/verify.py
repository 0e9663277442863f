"""Verify (MineDojo paper, datasheet: maintenance): that what is kept is what was written.

verify     every byte of a data root or a release
mended     what is damaged is set aside and asked for again; what can be made from raw is made
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from kb.artifacts.build import clear_finished
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.pipeline import load, locate
from kb.core.sources import PUBLISHED, exported_by
from kb.crawl.session import open_session
from kb.export import layouts
from kb.filters.clean import run_clean
from kb.pairs.build import build
from kb.reddit.connector.source import RedditSource
from kb.reddit.connector.source import crawl as crawl_reddit
from kb.release.build import release
from kb.search.build import follow
from kb.store import mending
from kb.store.layout import Layout
from kb.verify.found import Look
from kb.verify.repair import Crawl, Describe, Make, Step, repaired
from kb.verify.root import verify as look_at
from kb.wiki.connector.source import WikiSource
from kb.youtube.connector.source import YouTubeSource

SOURCES = {"youtube": YouTubeSource, "wiki": WikiSource, "reddit": RedditSource}


def verify(run: Run, folder: Path) -> Look:
    """Read everything; changes nothing."""
    return look_at(folder, run.progress)


def mended(run: Run) -> tuple[Look, list[str]]:
    """What is left after all that can be mended is, and lines of what was done."""
    return repaired(run.root, run.progress, steps(run))


def steps(run: Run) -> Iterator[Step]:
    """What can be had again, in the order of the data; each looks whether it has to be."""
    at, again = Layout(run.root), replace(run, again=True)
    for source in SOURCES:
        yield Crawl(source, partial(_set_aside, run, source), partial(_crawl, run, source))
        clean = partial(run_clean, run, source)
        yield Make("clean", f"kb {source} filter", clean, (at.clean(source),), after=source)
    yield Make("pairs", "kb pairs --again", partial(build, again), (at.pairs,))
    clear_finished(run.root, "pairs")
    links = partial(load(str(locate("links"))).tables, again)
    yield Make("links", "kb links --again", links, (at.links,))
    for source in SOURCES:
        step = partial(follow, again, source)
        yield Make("index", "kb index --again", step, (at.index(source),))
    for name in PUBLISHED:
        export = partial(layouts.export, run, name)
        yield Make("release", exported_by(name), export, (at.release(name),))
        yield Describe(name, partial(release, run, [name]))


def _set_aside(run: Run, source: str) -> list[str]:
    """Damaged stretches of raw data leave their segments, and what they held is to do again."""
    try:
        with open_session(run, SOURCES[source](run), asks=False, tells=False) as session:
            session.recorder.look_into_all()
            mending.tell(run.root, source, session.frontier)
    except DamagedData as error:
        return [f"{error}; {error.hint}"]
    return []


def _crawl(run: Run, source: str) -> object:
    return crawl_reddit(run) if source == "reddit" else load(str(locate(source))).crawl(run)
