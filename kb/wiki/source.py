"""The source wiki."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from kb.source import Source

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.card_answers import CardAnswer
    from kb.artifacts.purge import PurgeRules
    from kb.artifacts.release_folder import ReleaseFolder
    from kb.core.config.profile import Profile
    from kb.core.config.section import OnlineAnswer, QuestionCost
    from kb.core.context import Run
    from kb.core.summary import Summary
    from kb.crawl.connector import Connector
    from kb.export.layouts import Writer
    from kb.export.text import TextDocument, TextFiles
    from kb.links.texts import TextPart
    from kb.mcp.documents import AgentDocument, SourceLocation
    from kb.reader.tables import OpenTables
    from kb.report.figures import FigureMaker
    from kb.search.passage import Passage
    from kb.store.state.frontier import Frontier


class Wiki(Source):
    """Pages of a wiki as a browser shows them."""

    def connector(self, run: Run) -> Connector:
        from kb.wiki.crawl.connector import WikiConnector

        return WikiConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.wiki.crawl.online import question

        return question(run, cost)

    def plan(self, run: Run) -> Summary:
        from kb.wiki.crawl.connector import plan_crawl

        return plan_crawl(run)

    def requirements(self, run: Run) -> Iterator[tuple[str, str, str, str]]:
        from kb.wiki.browser.chromium import requirements

        return requirements()

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

    def figures(self) -> Sequence[FigureMaker]:
        from kb.wiki.report import FIGURES

        return FIGURES

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.wiki.card import gaps

        return gaps(con, folder)

    def answers(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> Sequence[CardAnswer]:
        from kb.wiki.card import answers

        return list(answers(con, root, folder))

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text
        from kb.wiki import tar_shards

        return {
            "parquet": tar_shards.export,
            "minedojo": minedojo.wiki,
            "text": partial(text.export, of=self),
        }

    def text_documents(self, files: TextFiles, origin: str) -> Iterator[TextDocument]:
        from kb.wiki.text import documents

        return documents(files)

    def purge_rules(self) -> PurgeRules:
        from kb.wiki.purge import RULES

        return RULES
