"""Verify (MineDojo paper, datasheet: maintenance): that what is kept is what was written.

verify     every byte of a data root or a release
repair     what is damaged is set aside and asked for again; what can be made from raw is made
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.pipeline import load, locate
from kb.core.sources import PUBLISHED, exported_by
from kb.crawl.session import open_session
from kb.export import parquet
from kb.filters.clean import run_clean
from kb.links.build import build as build_links
from kb.pairs.build import build, clear_finished
from kb.reddit.crawl import crawl as crawl_reddit
from kb.reddit.source import Reddit
from kb.release.build import release
from kb.search.build import follow
from kb.store import lock, mending
from kb.store.layout import Layout
from kb.verify import repair as mend
from kb.verify.found import Look
from kb.verify.repair import Step
from kb.verify.root import verify as look_at
from kb.wiki.source import WikiSource
from kb.youtube.source import YouTube

SOURCES = {"youtube": YouTube, "wiki": WikiSource, "reddit": Reddit}


def verify(run: Run, folder: Path) -> Look:
    """Read everything; changes nothing."""
    return look_at(folder, run.progress)


def mended(run: Run, folder: Path) -> tuple[Look, list[str]]:
    """Look, repair and look again, under all locks: (what is left, lines of what was done).

    Raises WriterLocked.
    """
    with lock.taking(run.root, *lock.ORDER):
        look = verify(run, folder)
        said = repair(run, look)  # of what was killed on its way nothing may be found any more
        return (verify(run, folder) if said else look), said


def repair(run: Run, look: Look) -> list[str]:
    """Mend what can be; a line for each thing done, or left and how to go on."""
    at = Layout(run.root)
    with lock.taking(run.root, *lock.ORDER):  # which clears what killed commands left
        said = mend.set_aside(run.root, look)
        for source in SOURCES:
            clean, fetched = at.clean(source), mend.fetched_by(run.root, look, source)
            if fetched:
                said += _set_aside(run, source)
                said += mend.tried(f"kb {source} crawl", partial(_crawl, run, source))
            if mend.made_again(look, "clean", clean) or (fetched and clean.is_dir()):
                step: Step = partial(run_clean, run, source)
                said += mend.make(look, f"kb {source} filter", clean, step)
        if mend.made_again(look, "pairs", at.pairs):
            step = partial(build, replace(run, again=True))
            said += mend.make(look, "kb pairs --again", at.pairs, step)
        clear_finished(run.root)
        if mend.made_again(look, "links", at.links):
            step = partial(_links, replace(run, again=True))
            said += mend.make(look, "kb links --again", at.links, step)
        for source in SOURCES:
            if mend.made_again(look, "index", at.index(source)):
                step = partial(follow, replace(run, again=True), source)
                said += mend.make(look, "kb index --again", at.index(source), step)
        for source in PUBLISHED:
            if mend.made_again(look, "release", at.release(source)):
                step = partial(_export, run, source)
                said += mend.make(look, exported_by(source), at.release(source), step)
            if mend.undescribed(at, source):
                said += mend.tried("kb release", partial(release, run, [source]))
    return said


def _set_aside(run: Run, source: str) -> list[str]:
    """Damaged stretches of raw data leave their segments, and what they held is to do again."""
    try:
        with open_session(run, SOURCES[source](run), asks=False, every=True) as session:
            mending.tell(run.root, source, session.frontier)
    except DamagedData as error:
        return [f"{error}; {error.hint}"]
    return []


def _crawl(run: Run, source: str) -> object:
    if source == "reddit":
        return crawl_reddit(run)
    given = (None, None, None) if source == "youtube" else ()
    return load(str(locate(source))).crawl(run, *given)


def _links(run: Run) -> object:
    names = load(str(locate("links"))).names
    return build_links(run, lambda: names(run))


def _export(run: Run, source: str) -> object:
    if source not in SOURCES:
        return parquet.export(run, source)
    return load(str(locate(source))).export(run, "parquet")
