"""A source: what the rest of Lorecrawl needs to know of YouTube, the wiki or Reddit.

What is plain data is a class attribute, what is behaviour a method with a default for sources that
have nothing to say. A method imports what it needs when it is called: every command reads the
classes, and `kb --help` must not pay for a browser.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar
from urllib.parse import SplitResult

from kb.core.errors import UsageError
from kb.core.publication import Publication

if TYPE_CHECKING:
    from kb.artifacts.purge import PurgeRules
    from kb.core.config.profile import Profile
    from kb.core.config.profile.base import OnlineAnswer, QuestionCost, Section
    from kb.core.context import Run
    from kb.crawl.connector import Connector
    from kb.export.text import TextDocument
    from kb.links.texts import TextPart
    from kb.mcp.documents import AgentDocument, SourceLocation
    from kb.reader.tables import OpenTables
    from kb.search.passage import Passage
    from kb.store.state.frontier import Frontier


class Source(Publication, ABC):
    """One source of Lorecrawl, to inherit from. `name` is also that of raw/<name>, clean/<name> …
    and of the group of its commands."""

    help: ClassVar[str]
    """One line for `kb --help`."""

    tables: ClassVar[Mapping[str, str]]
    """Tables that the filter sorts → what their keys begin with in rejected, failed and pending."""

    nouns: ClassVar[Mapping[str, str]]
    """Kinds of the frontier in the order of work → nouns for messages."""

    counted: ClassVar[str]
    """The noun of what a crawl counts."""

    only: ClassVar[str] = ""
    """Who knows what no other source names: "only videos"."""

    noted: ClassVar[tuple[str, ...]] = ()
    """Kinds of the frontier that are never fetched."""

    unfiltered: ClassVar[tuple[str, ...]] = ()
    """Raw kinds that no filter reads: samples that measures compare, what lists named."""

    crawl_settings: ClassVar[tuple[str, ...]] = ()
    """Keys of its section of the profile that a crawl or a refresh reads, and no filter."""

    files: ClassVar[tuple[str, ...]] = ()
    """Folders below raw/<name> with captured files."""

    credential: ClassVar[str] = ""
    """The setting without which a crawl is not offered as a next step."""

    keyless: ClassVar[str] = ""
    """The phase of its crawl that needs no credential, as `--only` names it."""

    waiting: ClassVar[Mapping[str, str]] = {}
    """What ends the waiting of pending rows, by their reason."""

    refreshed: ClassVar[str] = ""
    """The kind that `kb refresh` fetches; "" without such a command."""

    restored: ClassVar[bool] = False
    """Whether `kb restore` brings back its content."""

    linked: ClassVar[tuple[str, ...]] = ()
    """Tables in whose texts entities are found."""

    indexed: ClassVar[tuple[str, ...]] = ()
    """Tables that passages are made of."""

    textual: ClassVar[tuple[str, ...]] = ()
    """Tables that documents of `--format text` are made of, first the one with a row for each."""

    ref: ClassVar[str] = ""
    """An example of a reference to a place in it; "" when `read` shows nothing of it."""

    mark: ClassVar[str] = "#"
    """What stands between the key and the position in a reference."""

    hosts: ClassVar[tuple[str, ...]] = ()
    """Endings of the hosts of its links; none when its links are those of any other host."""

    dated: ClassVar[tuple[str, str]] = ("fetched_at", "fetched")
    """The column of the main table that dates a row, and what happened then."""

    unlicensed: ClassVar[str] = ""
    """A sentence on licences where rows name none of their own."""

    annotate_help: ClassVar[str] = "Score its texts."
    annotate_examples: ClassVar[tuple[str, ...]] = ()
    purge_help: ClassVar[str] = "Remove what is named, everywhere, and remember it."
    purge_examples: ClassVar[tuple[str, ...]] = ()

    # -- crawl -------------------------------------------------------------------------------------

    @abstractmethod
    def connector(self, run: Run) -> Connector:
        """What crawls the source."""

    def section(self) -> type[Section] | None:
        """The class of its section in the profile, where ShippedProfile does not declare it."""
        return None

    def question(self, run: Run, cost: QuestionCost) -> OnlineAnswer | None:
        """One question to the service for `kb profile check --online`; its cost goes to `cost`."""
        return None

    # -- status ------------------------------------------------------------------------------------

    def crawled(self, frontier: Frontier) -> int:
        """Items read by all crawls, as their summaries count them."""
        kinds = [kind for kind, noun in self.nouns.items() if noun == self.counted]
        return sum(frontier.counts(kind).get("done", 0) for kind in kinds)

    def status(self, run: Run, frontier: Frontier) -> dict[str, Any]:
        """What `kb status` shows of the state beside the counts of items."""
        return {}

    def incomplete(self, root: Path) -> dict[str, Any]:
        """What `kb status` shows of items that could be read in part only."""
        return {}

    def model(self, run: Run) -> str:
        """The model with its revision that would score its texts now; "" where none is installed,
        and the scores that are stored are used as they are.
        """
        from kb.annotate.toxicity import installed

        return installed(run.settings)

    # -- tables ------------------------------------------------------------------------------------

    def texts(self, table: str, path: Path) -> Iterator[TextPart]:
        """The texts in a file of one of the `linked` tables, in batches."""
        return iter(())

    def passages(self, profile: Profile, root: Path) -> Iterator[Passage]:
        """What `kb search` indexes."""
        return iter(())

    def text_documents(self, files: Mapping[str, str], origin: str) -> Iterator[TextDocument]:
        """The documents of `--format text` of one bucket: `files` of the `textual` tables, "" for
        one without rows, and the address of the service. Raises DamagedData.
        """
        return iter(())

    def purge_rules(self) -> PurgeRules:
        """The rules of `kb purge`; by default items are removed by name only."""
        from kb.crawl.purge import rules_by_name

        return rules_by_name(self)

    # -- places ------------------------------------------------------------------------------------

    def document(self, tables: OpenTables, place: SourceLocation) -> AgentDocument:
        """What `read` shows around a place. Raises UsageError for an unknown one, DamagedData."""
        raise UsageError(f"`read` does not support {self.name}", hint="use `query`")

    def place_of(self, url: SplitResult) -> tuple[str, str] | None:
        """The key and the position that a link names."""
        return None

    def bare(self, key: str, at: str) -> tuple[str, str]:
        """The key and the position of a reference, without prefixes."""
        return key, at

    def address(self, key: str) -> str:
        """The URL of an item at the service; "" where the key alone does not give one."""
        return ""

    # -- names -------------------------------------------------------------------------------------

    @property
    def folder(self) -> Path:
        """The folder of its package."""
        return Path(str(sys.modules[type(self).__module__].__file__)).parent

    @classmethod
    def noun(cls, kind: str) -> str:
        """What an item of the frontier is called."""
        return cls.nouns.get(kind, kind.replace("_", " "))

    @classmethod
    def in_order(cls, kinds: Iterable[str]) -> list[str]:
        """Kinds of the frontier in the order of work, without those that are never fetched."""
        order = list(cls.nouns)
        known = [kind for kind in kinds if kind not in cls.noted]
        return sorted(known, key=lambda kind: order.index(kind) if kind in order else len(order))

    @classmethod
    def left_by(cls, kinds: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
        """Items that are left to fetch, by noun in the order of work; zeros are left out."""
        left = {
            cls.noun(kind): kinds[kind].get("todo", 0) + kinds[kind].get("in_progress", 0)
            for kind in cls.in_order(kinds)
        }
        return {noun: count for noun, count in left.items() if count}
