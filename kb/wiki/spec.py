"""What the wiki declares to the rest of Lorecrawl."""

from kb.core.source_spec import (
    AgentSpec,
    CommandHelp,
    ReleaseSpec,
    ReportSpec,
    SourceSpec,
    TextColumns,
)

SPEC = SourceSpec(
    name="wiki",
    package=__package__,
    help="Wiki pages as a browser shows them: crawl, filter, export.",
    tables={"pages": ""},
    nouns={
        "site": "site descriptions",  # what the wiki says of itself, once a round
        "titles": "title lists",  # lists of titles, one a namespace and round
        "info": "titles",  # titles whose revision is fetched, a round each
        "gone": "comparisons",  # rounds that are compared with the pages known before
        "pages": "pages",  # pages that the browser shows
        "files": "image files",  # original files of images
    },
    counted="pages",
    connector=".connector.source:WikiSource",
    purge=".purge:RULES",
    commands="kb.cli.commands.sources.wiki",
    section="kb.core.config.profile.wiki:Wiki",
    status=".connector.reduce",
    online=".connector.online:question",
    formats={"parquet": "kb.export.wiki_tar:export", "minedojo": "kb.export.minedojo_wiki:wiki"},
    exports=("minedojo/wiki_full", "minedojo/wiki_samples"),
    texts=(
        TextColumns("pages", "page_id", {"title": ("title",)}),
        TextColumns("elements", reader="kb.links.texts:visible_text"),
    ),
    pages="pages",
    passages="kb.search.wiki_passages:passages",
    indexed=("pages", "elements", "cells", "images"),
    files=("pages", "images"),
    release=ReleaseSpec(
        main="pages",
        query="SELECT kind, region, count(*) AS elements FROM wiki_elements WHERE visible"
        " GROUP BY ALL ORDER BY elements DESC",
        stages=("missing", "robots", "render", "words", "toxicity"),
        rules=("url", "namespaces", "min_words", "max_page_height", "max_elements"),
        gaps=("kb.release.metadata.gaps:large_screenshots",),
        archives=("screenshots", "images"),
        paths=(("pages", "screenshot_path"), ("images", "path")),
        licensed=("pages", "images"),
        licence="",
        scraped=True,
        origin="{url}",
        extra="wiki",
    ),
    report=ReportSpec(
        title="Wiki",
        tables=("wiki/pages", "wiki/elements", "wiki/images"),
        hint="run `kb wiki crawl`, then `kb wiki filter`",
        figures="kb.report.sources:WIKI",
        samples={
            "wiki/pages": ("title", "word_count", "page_width", "page_height", "license", "url")
        },
        only="only the wiki",
        color="green",
    ),
    agent=AgentSpec(
        time=("revision_timestamp", "last edited"),
        reader="kb.mcp.wiki:document",
        link="kb.mcp.wiki:from_link",
        ref="wiki:PAGE#Section",
        between="#",
    ),
    annotate_help=CommandHelp(
        "Score the text of crawled wiki pages.",
        ("kb annotate wiki                        each page's visible text",),
    ),
    purge_help=CommandHelp(
        """Remove pages that the wiki deleted or that are named, and never collect them again.

    The file names pages by id, title or URL, one per line, or is MineDojo's JSON. Names that match
    nothing are counted as unknown, and are skipped by later crawls.
    """,
        ("kb purge wiki --ids pages.txt",),
    ),
)
