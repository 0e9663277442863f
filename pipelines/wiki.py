"""Wiki (MineDojo paper, data collection appendix: "Wiki").

Every page as a person sees it: a full-page screenshot with the boxes of its elements, texts,
tables, images with captions, sprites, and all frames of what moves.

    crawl      list the pages, ask for their revisions, show them in the browser, fetch the
               originals
    clean      missing, robots, render (facts of the crawl), then the filters below
    export     tables with tar shards of screenshots and images, or MineDojo's layout
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from kb.annotate import toxicity
from kb.core.context import Run
from kb.core.profile import Profile
from kb.core.verdict import Summary
from kb.export.minedojo_wiki import wiki
from kb.filters.chain import Chain, Clean, Follow, SideFiles
from kb.filters.judgement import Predicate
from kb.filters.predicates import AtLeast, AtMost, Present, Told, Waits
from kb.store.buckets import Kind
from kb.wiki import parse, tables
from kb.wiki.assemble import HELPERS, assemble
from kb.wiki.shown import Rules


def crawl(run: Run, titles: Path | None = None) -> Summary:
    """Pages through the API and the browser; `titles` names them and skips the list."""
    from kb.wiki.source import crawl

    return crawl(run, titles)


def stages(p: Profile) -> tuple[Predicate, ...]:
    """What the crawl found out, then what a captured page must be like."""
    most = p.toxicity.threshold("wiki")
    return (
        Waits("state", ("unanswered",), stage="missing", reason="unanswered", verdict="failed"),
        Told("missing", stage="missing"),
        *(
            Present(column, stage="missing")
            for column in ("page_id", "title", "url", "revision_id", "revision_timestamp")
        ),
        Told("robots", value="said", stage="robots"),
        Told("render", value="said", stage="render"),
        Waits("captured", (False,), stage="render", reason="render"),
        AtLeast("word_count", p.section("wiki").min_words, stage="words"),
        *(
            (AtMost("toxicity", most, stage="toxicity", null_passes=True),)
            if most is not None
            else ()
        ),
    )


def clean(p: Profile) -> Clean:
    """Raw answers and captured pages to pages, elements, cells, images, facts and recipes."""
    markup = p.section("wiki").markup
    rules = Rules(markup.units, markup.item)
    return Clean(
        source="wiki",
        kinds={
            "pages": Kind(
                parse.pages, key=("of", "name"), bucket="name", prefer="answered", echo="echo"
            ),
            "renders": Kind(
                parse.renders, key=("page_id", "captured", "revision_id", "title"), bucket="page_id"
            ),
            "files": Kind(parse.files, key=("key",), named_by=("renders", "files")),
            "site": Kind(parse.site, key=()),
            "titles": Kind(parse.nothing, key=()),
            "imageinfo": Kind(parse.nothing, key=()),
        },
        assemble=partial(assemble, url=p.section("wiki").url),
        chains=(
            Chain(
                "wiki/pages",
                "key",
                stages(p),
                scores={"text": "toxicity"},
                helpers=HELPERS,
                also=("title", "of_page"),
                told=("title",),
            ),
        ),
        follow=tuple(Follow(name, of="wiki/pages", on="page_id") for name in tables.PARTS),
        scorer=toxicity,
        side_files=SideFiles(partial(tables.read_pages, rules=rules), tables.size),
    )


def export(run: Run, format: str = "parquet") -> Summary:
    """clean/wiki to release/wiki, or to export/minedojo/wiki_full."""
    if format == "minedojo":
        return wiki(run)
    from kb.export.wiki_tar import export

    return export(run)
