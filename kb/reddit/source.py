"""The source Reddit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.source import Source

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.purge import PurgeRules
    from kb.artifacts.release_folder import ReleaseFolder
    from kb.artifacts.restore import RestoreJob, WantedContent
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


class Reddit(Source):
    """Posts and comments of a subreddit."""

    def connector(self, run: Run) -> Connector:
        from kb.reddit.crawl.connector import RedditConnector

        return RedditConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.reddit.crawl.client import question

        return question(run, cost)

    def plan(self, run: Run) -> Summary:
        from kb.reddit.plan import plan_crawl

        return plan_crawl(run)

    def crawled(self, frontier: Frontier) -> int:
        from kb.reddit.crawl.reduce import crawled

        return crawled(frontier)

    def status(self, run: Run, frontier: Frontier) -> dict[str, Any]:
        from kb.reddit.status import incomplete

        return incomplete(run.root)

    def restoring(
        self, run: Run, content: WantedContent, clean: Callable[..., object]
    ) -> RestoreJob:
        from kb.reddit.restore.reconstruct import ThreadRestore

        return ThreadRestore(run, content)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns

        if table == "comments":
            return in_columns(path, "comment_id", {"comment": ("body",)}, "t1_")
        parts = {"title": ("title",), "body": ("body", "poll_options")}
        return in_columns(path, "post_id", parts, "t3_")

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.reddit.passages import passages

        return passages(profile, root)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from kb.reddit.documents import document

        return document(tables, place)

    def figures(self) -> Sequence[FigureMaker]:
        from kb.reddit.report import FIGURES

        return FIGURES

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.reddit.card import gaps

        return gaps(con, folder)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text

        return {
            "minedojo": minedojo.reddit,
            "text": partial(text.export, of=self),
        }

    def text_documents(self, files: TextFiles, origin: str) -> Iterator[TextDocument]:
        from kb.reddit.text import documents

        return documents(files, origin)

    def purge_rules(self) -> PurgeRules:
        from kb.reddit.purge import RULES

        return RULES
