"""`kb wiki`: pages as a browser shows them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kb.cli.framework.command import command, group
from kb.cli.framework.options import Plan, pipeline
from kb.cli.framework.source_commands import add_export, add_filter
from kb.core.context import Run
from kb.core.summary import Summary

app = group("Collect wiki pages: screenshots, elements with boxes, tables and images.")


@command(
    app,
    uses=("workers", "wait", "pipeline"),
    limit="Stop after N more pages (exit code 3); the next run resumes.",
    again="Start a new round: list the wiki again, and render only new pages and revisions.",
    json="crawled, images, failed, pending, robots, gone, requests",
    planned=("titles", "workers"),
    checks=True,
    examples=[
        "kb wiki crawl --plan                     what is left and how long it takes",
        "kb wiki crawl --limit 100                100 pages, then exit code 3",
        "kb wiki crawl --again --workers 2        what has changed, with two browsers",
        "kb wiki crawl --titles titles.txt        named pages, no discovery",
    ],
)
def crawl(
    run: Run,
    titles: Annotated[
        Path | None,
        typer.Option(
            "--titles",
            metavar="FILE|FOLDER",
            help="Crawl these page titles instead of listing the wiki: lines, CSV, JSON (MineDojo's"
            " or the API's allpages), a dump's list of all titles, a released Parquet file, or the"
            " folder of a release or of wiki_full.",
        ),
    ] = None,
    plan: Plan = False,
) -> Summary:
    """Render every content page in headless Chromium, and keep what a reader sees.

    Needs KB_CONTACT, Chromium and chromedriver. A second crawl (--again) renders only what has
    changed. Pages and images follow robots.txt, and every request its crawl-delay. API requests
    follow MediaWiki's etiquette (a contact, maxlag, Retry-After), even where robots.txt closes the
    API's folder to all crawlers; a rule that names `lorecrawl` is obeyed there too.
    """
    if plan:
        from kb.wiki.crawl.connector import plan_crawl

        return plan_crawl(run, titles)
    summary: Summary = pipeline(run, "wiki").crawl(run, titles)
    return summary


add_filter(app, "wiki", "captured pages")
add_export(
    app,
    "wiki",
    goes="Parquet and tar shards go",
    tables="the released tables with their images",
)
