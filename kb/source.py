"""What a source does, and what is published of it: the classes that its package inherits.

What a source *is* (tables, nouns, hosts, texts) is declared in its `schemas/`
(`kb.core.sources.SourceDeclaration`). Commands and recipes look a class up in `kb.registry` and
hand it to the rooms below, each of which asks for the methods that it needs. A method imports what
it needs when it is called: every command reads the classes, and `kb --help` must not pay for a
browser.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kb.core.sources import PUBLISHED, SOURCES, Publication, SourceDeclaration

if TYPE_CHECKING:
    from duckdb import DuckDBPyConnection

    from kb.artifacts.card_answers import CardAnswer
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


class Published:
    """What can be done with a release folder and its section in the report, to inherit from."""

    def __init__(self, name: str) -> None:
        self.name = name

    @property
    def declared(self) -> Publication:
        """Its declaration."""
        return PUBLISHED[self.name]

    def writers(self) -> Mapping[str, Writer]:
        """The writers of the export formats, and of Parquet where tables are not all of it."""
        return {}

    def gaps(self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder) -> Iterator[str]:
        """What the released rows lack, measured on them and on the clean ones: sentences for card
        and datasheet.
        """
        return iter(())

    def quality(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> tuple[str, ...]:
        """How good the released rows are, with figures: sentences for card and datasheet."""
        return ()

    def answers(
        self, con: DuckDBPyConnection, root: Path, folder: ReleaseFolder
    ) -> Sequence[CardAnswer]:
        """Questions that the released rows answer, asked of them: a section of the card."""
        return ()

    def figures(self) -> Sequence[FigureMaker]:
        """What the report draws; by default what each filter stage leaves over."""
        from kb.report.figures import funnel

        return [partial(funnel, name=name) for name in self.declared.shown]


class Source(Published, ABC):
    """One source of Lorecrawl, to inherit from. Its package declares the rest."""

    @property
    def declared(self) -> SourceDeclaration:
        """Its declaration."""
        return SOURCES[self.name]

    # -- crawl -------------------------------------------------------------------------------------

    @abstractmethod
    def connector(self, run: Run) -> Connector:
        """What crawls the source."""

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer | None:
        """One question to the service for `kb profile check --online`; its cost goes to `cost`."""
        return None

    def plan(self, run: Run) -> Summary | None:
        """What a crawl would ask for, as `kb <source> crawl --plan` shows it; sends nothing."""
        return None

    def requirements(self, run: Run) -> Iterator[tuple[str, str, str, str]]:
        """What a crawl needs of this machine, for `kb doctor`: (level, what, state, fix)."""
        return iter(())

    def crawled(self, frontier: Frontier) -> int:
        """Items read by all crawls, as their summaries count them."""
        nouns, counted = self.declared.nouns, self.declared.counted
        kinds = [kind for kind, noun in nouns.items() if noun == counted]
        return sum(frontier.counts(kind).get("done", 0) for kind in kinds)

    def status(self, run: Run, frontier: Frontier) -> dict[str, Any]:
        """What `kb status` shows of the state beside the counts of items."""
        return {}

    def purge_rules(self) -> PurgeRules:
        """The rules of `kb purge`; by default items are removed by name only."""
        from kb.crawl.purge import rules_by_name

        return rules_by_name(self.declared)

    def restoring(
        self, run: Run, content: WantedContent, clean: Callable[..., object]
    ) -> RestoreJob:
        """What `kb restore` brings back, where the source declares `restored`; `clean(run, source)`
        makes clean tables of a work folder.
        """
        from kb.crawl.restore import ItemRestore

        return ItemRestore(run, content, self.declared, self.connector, clean)

    # -- tables ------------------------------------------------------------------------------------

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        """The texts in a file of one of the `linked` tables, in batches."""
        return iter(())

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        """What `kb search` indexes."""
        return iter(())

    def text_documents(self, files: TextFiles, origin: str) -> Iterator[TextDocument]:
        """The documents of `--format text` of one bucket: `files` of the `textual` tables, none
        for one without rows, and the address of the service. Raises DamagedData.
        """
        return iter(())

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        """What `read` shows around a place. Raises UsageError for an unknown one, DamagedData."""
        raise NotImplementedError  # a source that declares no `ref` is not asked
