"""What a source declares about itself: `SPEC` in `kb/<source>/spec.py`.

A spec is light data. It names the modules and functions that do the work as "module:attribute",
and they are imported when they are first needed: `kb --help` reads every spec and no connector.
"""

import importlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any


def load_name(name: str, package: str | None = None) -> Any:
    """The module that "module" names, or the attribute that "module:attribute" names."""
    module, _, attribute = name.partition(":")
    loaded = importlib.import_module(module, package)
    return getattr(loaded, attribute) if attribute else loaded


@dataclass(frozen=True)
class CommandHelp:
    """Help text and examples of a command that every source has."""

    about: str
    examples: tuple[str, ...] = ()


@dataclass(frozen=True)
class TextColumns:
    """The texts of one table that `kb links` matches.

    `parts` maps the name of a part to the columns that hold its text. `prefix` comes before the
    bare `key`. `reader` ("module:function") reads the table instead when columns are not enough.
    """

    table: str
    key: str = ""
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    prefix: str = ""
    reader: str = ""


@dataclass(frozen=True)
class ReleaseSpec:
    """What a release folder holds, of a source or of what is made from sources.

    main        the table that a reader means who names none
    query       the first query on the card
    counted     tables whose rows go through the filters; `main` alone by default
    stages      the stages of the filters, in order, which the card pictures
    pictured    the column whose frequent values it pictures instead
    rules       keys of the profile that decide which rows are released
    section     the section of these keys; the source's own by default
    gaps        functions that describe what the tables lack
    quality     the function that describes how good the rows are, with figures
    ids_only    text columns hold ids and short names only
    archives    kinds of tar archives beside the tables
    paths       (table, column) pairs that name a file in an archive
    licensed    tables whose rows name a licence of their own
    licence     SPDX id when the profile gives none
    scraped     whether some of it was read from web pages
    origin      address of the service, with keys of the profile's section in braces
    extra       the package extra that the card's commands need
    part_of     the source whose filter and export also make this folder, of licensed texts
    """

    main: str
    query: str
    counted: tuple[str, ...] = ()
    stages: tuple[str, ...] = ()
    pictured: str = ""
    rules: tuple[str, ...] = ()
    section: str = ""
    gaps: tuple[str, ...] = ()
    quality: str = ""
    ids_only: bool = False
    archives: tuple[str, ...] = ()
    paths: tuple[tuple[str, str], ...] = ()
    licensed: tuple[str, ...] = ()
    licence: str = "CC-BY-4.0"
    scraped: bool = False
    origin: str = ""
    extra: str = ""
    part_of: str = ""


@dataclass(frozen=True)
class ReportSpec:
    """What `kb report` shows of a source, or of what is made from sources.

    title       the heading
    tables      tables with a card
    hint        what to run while there is no data
    figures     the functions that draw; by default what each filter stage leaves over
    samples     columns of the sample rows, by table
    only        who knows what no other source names: "only videos"
    color       of the panel with its requests: red, blue, green or grey
    units       whether its ledger counts units of a quota
    """

    title: str
    tables: tuple[str, ...]
    hint: str
    figures: str = ""
    samples: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    only: str = ""
    color: str = "grey"
    units: bool = False


@dataclass(frozen=True)
class AgentSpec:
    """What `kb mcp` says of a source and reads around a place in it.

    time        the column that dates a row, and the verb: ("published_at", "published")
    reader      function that reads what stands around a place
    link        function that takes a URL apart into a place
    ref         an example of a ref
    between     the character between key and position in a ref
    hosts       endings of the hosts whose URLs `link` takes; none for any other host
    note        a sentence about licences; "" when rows name their own
    prefixes    prefixes that are taken off a key and a position
    item        URL of an item, with {key}
    """

    time: tuple[str, str]
    reader: str
    link: str
    ref: str
    between: str
    hosts: tuple[str, ...] = ()
    note: str = ""
    prefixes: tuple[str, str] = ("", "")
    item: str = ""


@dataclass(frozen=True)
class SourceSpec:
    """One source of Lorecrawl. Names of code are "module:attribute", relative to `package` when
    they begin with a dot.

    name            the folders raw/<name>, clean/<name> … and its commands
    package         the package of its modules
    help            one line for `kb --help`
    tables          tables that a filter sorts → what their keys begin with in rejected, failed
                    and pending
    nouns           kinds of the frontier in the order of work → nouns for messages
    counted         the noun of what a crawl counts
    connector       the crawl frame's Source
    purge           the rules of `kb purge`; by default items are removed by name only
    release         the release folder
    report          the report's section
    noted           kinds of the frontier that are never fetched
    refreshed       the kind that `kb refresh` fetches; "" without such a command
    credential      the setting without which a crawl is not offered as a next step
    commands        the module of the commands; without it there are crawl, filter and export
    section         the class of its section in the profile
    status          the module with what `kb status` counts: `crawled(frontier)`, and optionally
                    `details(run, frontier)` and `incomplete(root)`
    online          the question of `kb profile check --online`
    formats         export formats besides Parquet → their writers
    exports         files and folders that they write below export/
    texts           the texts in which links are found
    pages           the table whose rows are the pages of entities
    passages        the passages that `kb search` indexes, as a function of profile and data root
    indexed         the tables that passages are made of
    samples         raw kinds that no filter reads: samples that measures compare
    made            what else is made from its rows: "pairs"
    files           folders below raw/<name> with captured files
    agent           what `kb mcp` reads
    restored        tables that `kb restore` brings back
    annotate_help   help of `kb annotate <source>`
    purge_help      help of `kb purge <source>`
    """

    name: str
    package: str
    help: str
    tables: Mapping[str, str]
    nouns: Mapping[str, str]
    counted: str
    connector: str
    release: ReleaseSpec
    report: ReportSpec
    purge: str = ""
    noted: tuple[str, ...] = ()
    refreshed: str = ""
    credential: str = ""
    commands: str = ""
    section: str = ""
    status: str = ""
    online: str = ""
    formats: Mapping[str, str] = field(default_factory=dict)
    exports: tuple[str, ...] = ()
    texts: tuple[TextColumns, ...] = ()
    pages: str = ""
    passages: str = ""
    indexed: tuple[str, ...] = ()
    samples: tuple[str, ...] = ()
    made: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    agent: AgentSpec | None = None
    restored: tuple[str, ...] = ()
    annotate_help: CommandHelp | None = None
    purge_help: CommandHelp | None = None

    def load(self, name: str) -> Any:
        """The module or the attribute ("module:attribute") that a field names."""
        return load_name(name, self.package)

    def noun(self, kind: str) -> str:
        """What an item of the frontier is called."""
        return self.nouns.get(kind, kind.replace("_", " "))

    def in_order(self, kinds: Iterable[str]) -> list[str]:
        """Kinds of the frontier in the order of work, without those that are never fetched."""
        order = list(self.nouns)
        known = [kind for kind in kinds if kind not in self.noted]
        return sorted(known, key=lambda kind: order.index(kind) if kind in order else len(order))

    def left_by(self, kinds: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
        """Items that are left to fetch, by noun in the order of work; zeros are left out."""
        left = {
            self.noun(kind): kinds[kind].get("todo", 0) + kinds[kind].get("in_progress", 0)
            for kind in self.in_order(kinds)
        }
        return {noun: count for noun, count in left.items() if count}
