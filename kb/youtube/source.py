"""The source YouTube."""

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


class YouTube(Source):
    """Videos and transcripts."""

    def connector(self, run: Run) -> Connector:
        from kb.youtube.crawl.connector import YouTubeConnector

        return YouTubeConnector(run)

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer:
        from kb.youtube.crawl.client import question

        return question(run, cost)

    def plan(self, run: Run) -> Summary:
        from kb.youtube.plan import plan

        return plan(run)

    def crawled(self, frontier: Frontier) -> int:
        from kb.youtube.crawl.reduce import crawled

        return crawled(frontier)

    def status(self, run: Run, frontier: Frontier) -> dict[str, Any]:
        from kb.youtube.status import status

        return status(run, frontier)

    def restoring(
        self, run: Run, content: WantedContent, clean: Callable[..., object]
    ) -> RestoreJob:
        from kb.youtube.restore import VideoRestore

        return VideoRestore(run, content, self.declared, self.connector, clean)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns, in_transcripts

        if table == "transcripts":
            return in_transcripts(path)
        return in_columns(path, "video_id", {"title": ("title",), "body": ("description",)})

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from kb.youtube.passages import passages

        return passages(profile, root)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from kb.youtube.documents import document

        return document(tables, place)

    def figures(self) -> Sequence[FigureMaker]:
        from kb.youtube.report import FIGURES

        return FIGURES

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        from kb.youtube.card import gaps

        return gaps(con, root, folder)

    def writers(self) -> Mapping[str, Writer]:
        from kb.export import minedojo, text

        return {"minedojo": minedojo.youtube, "text": partial(text.export, of=self)}

    def text_documents(self, files: TextFiles, origin: str) -> Iterator[TextDocument]:
        from kb.youtube.text import documents

        return documents(files)

    def purge_rules(self) -> PurgeRules:
        from kb.youtube.purge import RULES

        return RULES
