"""The source wiki."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, urlunsplit

from kb.core.publication import RecordedWay
from kb.core.source import Source

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.purge import PurgeRules
    from kb.artifacts.release_folder import ReleaseFolder
    from kb.core.config.profile import Profile
    from kb.core.config.profile.base import OnlineAnswer, QuestionCost
    from kb.core.context import Run
    from kb.crawl.connector import Connector
    from kb.export.layouts import Writer
    from kb.export.text import TextDocument
    from kb.links.texts import TextPart
    from kb.mcp.documents import AgentDocument, SourceLocation
    from kb.reader.tables import OpenTables
    from kb.report.figures import FigureMaker
    from kb.search.passage import Passage
    from kb.store.state.frontier import Frontier


# What of [wiki.markup] a crawl reads; the rest belongs to the filter.
_MARKUP = (
    "root",
    "chrome",
    "denominator",
    "reference",
    "regions",
    "sprite",
    "sprite_image",
    "animation",
    "animation_active",
    "animation_group",
    "fact",
    "fact_field",
    "fact_value",
    "fact_subject",
    "recipe",
    "slot",
    "slot_row",
    "slot_output",
    "quantity",
    "title",
    "folded",
    "formula",
    "fraction",
)


class Wiki(Source):
    """Pages of a wiki as a browser shows them."""

    name = "wiki"
    help = "Wiki pages as a browser shows them: crawl, filter, export."
    tables = {"pages": ""}
    nouns = {
        "site": "site descriptions",  # what the wiki says of itself, once a round
        "titles": "title lists",  # lists of titles, one a namespace and round
        "info": "titles",  # titles whose revision is fetched, a round each
        "gone": "comparisons",  # rounds that are compared with the pages known before
        "pages": "pages",  # pages that the browser shows
        "files": "image files",  # original files of images
    }
    counted = "pages"
    files = ("pages", "images")
    unfiltered = ("seeds",)
    crawl_settings = (
        "hosts",
        "namespaces",
        "viewport_width",
        "viewport_height",
        "settle_seconds",
        "page_seconds",
        "max_page_height",
        "max_elements",
        "max_pixels",
        "max_file_bytes",
        "max_tries",
        "seconds_between",
        *(f"markup.{name}" for name in _MARKUP),
    )
    linked = ("pages", "elements")
    indexed = ("pages", "elements", "cells", "images")
    exports = ("minedojo/wiki_full", "minedojo/wiki_samples", "text/wiki.jsonl")
    textual = ("pages", "elements", "cells", "facts", "recipes")
    main = "pages"
    query = (
        "SELECT kind, region, count(*) AS elements FROM wiki_elements WHERE visible"
        " GROUP BY ALL ORDER BY elements DESC"
    )
    stages = ("missing", "robots", "render", "words", "toxicity")
    rules = (
        "wiki.url",
        "wiki.namespaces",
        "wiki.min_words",
        "wiki.max_page_height",
        "wiki.max_elements",
    )
    archives = ("screenshots", "images")
    paths = (("pages", "screenshot_path"), ("images", "path"))
    licensed = ("pages", "images")
    licence = ""
    ways = {"listed": RecordedWay(raw="titles"), "named": RecordedWay(raw="titles", absent=True)}
    extra = "wiki"
    title = "Wiki"
    shown = ("wiki/pages", "wiki/elements", "wiki/images")
    totals = (
        ("pages", "wiki/pages", "count(*)"),
        ("words on pages", "wiki/pages", "sum(word_count)"),
        ("boxes", "wiki/elements", "count(*) FILTER (visible)"),
        ("image files", "wiki/images", "count(DISTINCT sha256)"),
    )
    hint = "run `kb wiki crawl`, then `kb wiki filter`"
    sampled = {"wiki/pages": ("title", "word_count", "page_width", "page_height", "license")}
    only = "only the wiki"
    ref = "wiki:PAGE#Section"
    dated = ("revision_timestamp", "last edited")
    annotate_help = "Score the text of crawled wiki pages."
    annotate_examples = ("kb annotate wiki                        each page's visible text",)
    purge_help = """\
    Remove pages that the wiki deleted or that are named, and never collect them again.

    The file names pages by id, title or URL, one per line, or is MineDojo's JSON. Names that match
    nothing are counted as unknown, and are skipped by later crawls.
    """
    purge_examples = ("kb purge wiki --ids pages.txt",)

    def connector(self, run: Run) -> Connector:
        from kb.wiki.crawl.connector import WikiConnector

        return WikiConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.wiki.crawl.online import question

        return question(run, cost)

    def crawled(self, frontier: Frontier) -> int:
        from kb.wiki.crawl.reduce import crawled

        return crawled(frontier)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns, in_elements

        if table == "elements":
            return in_elements(path)
        return in_columns(path, "page_id", {"title": ("title",)})

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.wiki.passages import passages

        return passages(profile, root)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from kb.wiki.documents import document

        return document(tables, place)

    def place_of(self, url: SplitResult) -> tuple[str, str] | None:
        """The URL of the page, without its revision, and the section."""
        kept = "&".join(
            parameter for parameter in url.query.split("&") if not parameter.startswith("oldid=")
        )
        return urlunsplit(url._replace(query=kept, fragment="")), url.fragment

    def figures(self) -> Sequence[FigureMaker]:
        from kb.wiki.report import FIGURES

        return FIGURES

    def origin(self, profile: Profile) -> str:
        return profile.wiki.url if profile.wiki else ""

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.wiki.card import gaps

        return gaps(con, folder)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text, wiki_tar

        return {
            "parquet": wiki_tar.export,
            "minedojo": minedojo.wiki,
            "text": partial(text.export, source=self.name),
        }

    def text_documents(self, files: Mapping[str, str], origin: str) -> Iterator[TextDocument]:
        from kb.wiki.text import documents

        return documents(files)

    def purge_rules(self) -> PurgeRules:
        from kb.wiki.purge import RULES

        return RULES
