"""What the source of questions and answers does."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from kb.source import Source

if TYPE_CHECKING:
    from kb.core.config.profile import Profile
    from kb.core.context import Run
    from kb.crawl.connector import Connector
    from kb.links.texts import TextPart
    from kb.mcp.documents import AgentDocument, SourceLocation
    from kb.reader.tables import OpenTables
    from kb.search.passage import Passage


class QAndA(Source):
    """Questions and their answers."""

    def connector(self, run: Run) -> Connector:
        from kb.crawl.json_lists import JsonLists
        from qanda.lists import LISTS

        return JsonLists(run, self.declared, LISTS)

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        from kb.links.texts import in_columns

        if table == "answers":
            return in_columns(path, "answer_id", {"answer": ("body",)}, "a")
        parts = {"title": ("title",), "body": ("body",)}
        return in_columns(path, "question_id", parts, "q")

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        from qanda.documents import passages

        return passages(root, profile.section("qanda").url)

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        from qanda.documents import document

        return document(tables, place)
