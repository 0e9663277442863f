"""Wiki (MineDojo paper, data collection appendix: "Wiki").

Every page as a person sees it: a full-page screenshot with the boxes of its elements, texts,
tables, images with captions, sprites, and all frames of what moves.

    crawl      list the pages, ask for their revisions, show them in the browser, fetch the
               originals
    clean      missing, robots, render (facts of the crawl), then the filters below
    export     tables with tar shards of screenshots and images, or MineDojo's layout
"""

from functools import partial
from pathlib import Path

from kb.annotate import toxicity
from kb.core.config.profile import Profile
from kb.core.context import Run
from kb.core.summary import Summary
from kb.filters.chain import (
    Chain,
    Clean,
    Description,
    Follow,
    PurgeKeys,
    RawRows,
    SideFiles,
)
from kb.filters.predicates import AtLeast, Predicate, Present, RecordedReason, Waits, none_above
from kb.wiki.parse import tables as parsed
from kb.wiki.parse.decode import HELPERS, KINDS, assemble
from kb.wiki.parse.facts import MarkupRules
from kb.wiki.parse.graph import resolve_titles
from kb.wiki.section import WikiSection

NEEDED = ("page_id", "title", "url", "revision_id", "revision_timestamp")


def crawl(run: Run, titles: Path | None = None) -> Summary:
    """Pages through the API and the browser; `titles` names them and skips the list."""
    from kb.wiki.crawl.connector import crawl

    return crawl(run, titles)


def stages(p: Profile) -> tuple[Predicate, ...]:
    """What the crawl found out, then what a captured page must be like."""
    return (
        Waits("state", ("unanswered",), stage="missing", reason="unanswered", verdict="failed"),
        RecordedReason("missing", stage="missing"),
        *(Present(column, stage="missing") for column in NEEDED),
        RecordedReason("robots", value="said", stage="robots"),
        RecordedReason("render", value="said", stage="render"),
        RecordedReason("failed", stage="render", verdict="failed"),
        Waits("captured", (False,), stage="render", reason="render"),
        AtLeast("word_count", p.section(WikiSection).min_words, "words", "wiki.min_words"),
        *none_above(
            p.toxicity.threshold("wiki"), {"above": "toxicity"}, "toxicity.thresholds.wiki"
        ),
    )


def clean(p: Profile) -> Clean:
    """Raw answers and captured pages to pages, what stands on them, and what leads to which."""
    markup = p.section(WikiSection).markup
    rules = MarkupRules(markup.units, markup.item, markup.stations)
    scores, shown = {"text": "toxicity"}, {"title": "title", "text": "text"}
    rows = partial(assemble, url=p.section(WikiSection).url)
    pages = Chain(
        "wiki/pages",
        "key",
        stages(p),
        scores=scores,
        helpers=HELPERS,
        purged=PurgeKeys(also=("title", "of_page")),
        described=Description(shown),
    )
    captured = SideFiles(partial(parsed.read_pages, rules=rules), parsed.size)
    return Clean(
        source="wiki",
        raw=RawRows(KINDS, rows, captured),
        chains=(pages,),
        follow=tuple(Follow(name, of="wiki/pages", on="page_id") for name in parsed.PARTS),
        scorer=toxicity,
        across=lambda _, made: resolve_titles(made),
        figures=lambda _, made: parsed.figures(made),
    )
