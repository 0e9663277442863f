"""Wiki (MineDojo paper, data collection appendix: "Wiki").

Every page as a person sees it: a full-page screenshot with the boxes of its elements, texts,
tables, pictures with captions, sprites, and all frames of what moves.

    crawl      list the pages, ask for their revisions, show them in the browser, fetch the originals
    clean      missing, robots, render (facts of the crawl), then the filters below
    export     tables with tar shards of screenshots and pictures, or MineDojo's layout
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from kb.core.context import Run
from kb.core.profile import Profile
from kb.core.verdict import Summary


def crawl(run: Run, titles: Path | None = None) -> Summary:
    """Pages through the API and the browser; `titles` names them and skips the list."""
    from kb.wiki.crawl import crawl

    return crawl(run, titles)


def filters(p: Profile) -> list[Any]:
    """What a captured page must be like, in the contract's order of stages."""
    from kb.filters.predicates import AtLeast, AtMost

    stages: list[Any] = [AtLeast("word_count", p.section("wiki").min_words, stage="words")]
    most = p.toxicity.threshold("wiki")
    if most is not None:
        stages.append(AtMost("toxicity", most, stage="toxicity", null_passes=True))
    return stages


def clean(run: Run) -> Summary:
    """Raw pages to clean/wiki, scored and judged."""
    from kb.wiki.clean import clean

    scorer = None
    if run.profile.toxicity.on:
        from kb.annotate import toxicity as scorer
    return clean(run, filters(run.profile), scorer)


def texts(run: Run) -> Iterator[Any]:
    """What `kb annotate wiki` scores."""
    from kb.wiki.clean import texts

    return texts(run)


def export(run: Run, format: str = "parquet") -> Summary:
    """clean/wiki to release/wiki, or to export/minedojo/wiki_full."""
    if format == "minedojo":
        from kb.export.minedojo_wiki import wiki

        return wiki(run)
    from kb.export.wiki_tar import export

    return export(run)
