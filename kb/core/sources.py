"""The sources and what is published, as `schemas/` declares them.

    schemas/sources/<name>.toml         a source: the shipped ones, and those of installed packages
    schemas/publications/<name>.toml    what is made from sources: pairs, tasks, links, open text

Declarations are data, and all of a source that most of Lorecrawl knows. What a source does is its
class (`kb.source.Source`), which only commands and recipes look up (`kb.registry`). A package adds
a source by an entry point of the group `lorecrawl.sources`; its folder has `schemas/` as here.
"""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from urllib.parse import SplitResult, urlunsplit

import msgspec

from kb.core.errors import SettingError
from kb.core.installation import folder

ENTRY_POINTS = "lorecrawl.sources"
PACKAGES = Path(__file__).resolve().parent.parent


class RecordedWay(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a data root records that rows came by some way: by the value of a column, by raw
    answers of a kind, or by both, where some answers give no row.

    `ages`: the service's terms limit how old such rows may be. `absent`: the way of those without
    raw answers of the kind.
    """

    column: str = ""
    value: str = ""
    ages: bool = False
    raw: str = ""
    absent: bool = False


class LinkPattern(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a link names a place: regular expressions whose group is the key of the item and the
    position in it. Without `key` the key is the link itself without the parameters `ignored`, and
    its fragment is the position.
    """

    key: str = ""
    at: str = ""
    ignored: tuple[str, ...] = ()


class Publication(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One release folder and its section in the report.

    name        the folder release/<name>
    order       its place among the others
    title       the heading in the report
    shown       tables with rows for the report, which has no section without any
    totals      what the report's top counts: (what, table, SQL over its rows); by default the rows
                of each table that is shown
    hint        what to run while there is no data to show
    sampled     columns of the sample rows, by table
    main        the table that a reader means who names none
    query       the first query on the card
    stages      the stages of the filters, in order, which the card pictures
    pictured    the column whose frequent values the card pictures where there are no stages
    rules       keys of the profile that decide which rows are released
    ids_only    whether text columns hold ids and short names only
    archives    kinds of tar archives beside the tables
    paths       (table, column) pairs that name a file in an archive
    licensed    tables whose rows name a licence of their own
    licence     SPDX id when the profile gives none
    ways        how rows may have come, by the names that about.toml has sentences for
    extra       the package extra that the card's commands need
    part_of     the source whose filter and export also make this folder, of licensed texts
    selected_from   the publication of whose released rows it is a selection, which a command makes
                and no build makes again; several have names behind its own ("draw-small")
    lists       names of files beside the tables that the export writes
    made_of     the sources whose rows are behind it; () for all
    exports     files and folders that formats besides Parquet write below export/
    revision    the number of the rules by which its tables are made; raised where the same input
                gives others
    inputs      what it is made of besides the clean rows of its sources
    restored    what `kb restore` brings back, and with what, for the card; "" for nothing
    restored_query  a query over it, for the card
    decided_by  parts of the profile that decide its rows, where it is no source ("keywords": the
                lines of the keyword files too)
    """

    name: str
    order: int = 100
    title: str
    shown: tuple[str, ...] = ()
    totals: tuple[tuple[str, str, str], ...] = ()
    hint: str = ""
    sampled: dict[str, tuple[str, ...]] = {}
    main: str
    query: str
    stages: tuple[str, ...] = ()
    pictured: str = ""
    rules: tuple[str, ...] = ()
    ids_only: bool = False
    archives: tuple[str, ...] = ()
    paths: tuple[tuple[str, str], ...] = ()
    licensed: tuple[str, ...] = ()
    licence: str = "CC-BY-4.0"
    ways: dict[str, RecordedWay] = {}
    extra: str = ""
    part_of: str = ""
    selected_from: str = ""
    lists: tuple[str, ...] = ()
    made_of: tuple[str, ...] = ()
    exports: tuple[str, ...] = ()
    revision: int = 1
    inputs: tuple[str, ...] = ()
    decided_by: tuple[str, ...] = ()
    restored: str = ""
    restored_query: str = ""

    @property
    def aging(self) -> list[tuple[str, str]]:
        """Columns with the values of rows whose age the service's terms limit."""
        return [(way.column, way.value) for way in self.ways.values() if way.ages]

    @property
    def formats(self) -> list[str]:
        """The export formats besides Parquet."""
        return list(dict.fromkeys(place.partition("/")[0] for place in self.exports))


class DeclaredSetting(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A setting that a package adds, named by its variable in lower case. What is no `secret` may
    be shown.
    """

    description: str
    secret: bool = True


class DeclaredService(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a service of JSON answers may be asked (kb.crawl.json_lists).

    url              the key of the source's section with the address of the service
    per_day          units a day: a number, or the key of the source's section that has it; 0 for
                     as many as one likes
    units            units of a request by endpoint, where they are not 1
    time_zone        whose midnight begins the service's day
    seconds_between  at least so many between two requests
    key              the setting with the key; "" where none is sent
    sent             how it is sent: "query: NAME", or "header: NAME", with {} for it where there is
                     more in the header ("header: Authorization: Bearer {}")
    """

    url: str = "url"
    per_day: int | str = 0
    units: dict[str, int] = {}
    time_zone: str = "UTC"
    seconds_between: float = 0.0
    key: str = ""
    sent: str = "query: key"


class SourceDeclaration(Publication, frozen=True, kw_only=True):
    """A source. `name` is also that of raw/<name>, clean/<name> … and of its commands.

    package          the folder of its package
    module           the name of its package
    help             one line for `kb --help`
    tables           tables that the filter sorts → what their keys begin with in rejected, failed
                     and pending
    nouns            kinds of the frontier in the order of work → nouns for messages
    counted          the noun of what a crawl counts
    only             who knows what no other source names: "only videos"
    noted            kinds of the frontier that are never fetched
    unfiltered       raw kinds that no filter reads: samples that measures compare, what lists named
    rowless          raw kinds of which no row comes: what a crawl finds items by, what rows need
    crawl_settings   keys of its section of the profile that a crawl or a refresh reads, and no
                     filter
    figured          keys of its section that its figures in the report show
    imported         raw kinds that no crawl can ask for, and how they come again
    files            folders below raw/<name> with captured files
    credential       the setting without which a crawl is not offered as a next step
    keyless          the phase of its crawl that needs no credential, as `--only` names it
    waiting          what ends the waiting of pending rows, by their reason
    refreshed        the kind that `kb refresh` fetches; "" without such a command
    linked           tables in whose texts entities are found
    parts            what these texts are called in links: "title", "body"
    indexed          tables that passages are made of
    searched         what a search finds by each of these tables, as a plural noun; by default the
                     names of `tables`
    kinds            kinds of these passages, as `kb search --kind` names them
    textual          tables that documents of `--format text` are made of, first the one with a row
                     for each
    ref              an example of a reference to a place in it; "" when `read` shows nothing of it
    mark             what stands between the key and the position in a reference
    hosts            endings of the hosts of its links; none when its links are those of any other
                     host
    place            how a link names a place in it
    address          the URL of an item at the service, with {key}; "" where the key gives none
    origin           the address of the service, with names of settings in its section
    shape            how `kb explore` shows an item: "video" (a text with times, and its pairs),
                     "page" (blocks beside a screenshot), "thread" (a post with a tree of comments),
                     "" (its parts as text)
    facts            columns of the main table that stand at the head of an item's page
    elsewhere        stages that do not concern a table, by table
    scored           texts that are scored for toxicity; then [toxicity.thresholds] has a key for it
    counts_units     whether its ledger counts units of a quota, and not requests alone
    color            its colour in the report: "red", "green", "blue"; grey without one
    dated            the column of the main table that dates a row, and what happened then
    unlicensed       a sentence on licences where rows name none of their own
    settings         settings that it adds, by name
    service          how its service may be asked, where that is what `kb.crawl.json_lists` does
    """

    package: Path
    module: str
    help: str
    tables: dict[str, str]
    nouns: dict[str, str]
    counted: str
    only: str = ""
    noted: tuple[str, ...] = ()
    unfiltered: tuple[str, ...] = ()
    rowless: tuple[str, ...] = ()
    crawl_settings: tuple[str, ...] = ()
    figured: tuple[str, ...] = ()
    imported: dict[str, str] = {}
    files: tuple[str, ...] = ()
    credential: str = ""
    keyless: str = ""
    waiting: dict[str, str] = {}
    refreshed: str = ""
    linked: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    indexed: tuple[str, ...] = ()
    searched: dict[str, str] = {}
    kinds: tuple[str, ...] = ()
    textual: tuple[str, ...] = ()
    ref: str = ""
    mark: str = "#"
    hosts: tuple[str, ...] = ()
    place: LinkPattern = LinkPattern()
    address: str = ""
    origin: str = ""
    shape: str = ""
    facts: tuple[str, ...] = ()
    elsewhere: dict[str, tuple[str, ...]] = {}
    scored: str = ""
    counts_units: bool = False
    color: str = ""
    dated: tuple[str, str] = ("fetched_at", "fetched")
    unlicensed: str = ""
    settings: dict[str, DeclaredSetting] = {}
    service: DeclaredService | None = None
    annotate_help: str = "Score its texts."
    annotate_examples: tuple[str, ...] = ()
    purge_help: str = "Remove what is named, everywhere, and remember it."
    purge_examples: tuple[str, ...] = ()

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

    def table_of(self, name: str) -> tuple[str, str]:
        """The table of a key and the key in its rows, without what tells tables apart."""
        prefixes = {prefix: table for table, prefix in self.tables.items()}
        prefix = max(filter(name.startswith, prefixes), key=len, default="")
        return prefixes.get(prefix, self.main), name.removeprefix(prefix)

    def without_prefixes(self, key: str, at: str) -> tuple[str, str]:
        """The key and the position of a reference without what the keys of their tables begin with:
        an item of the main table, and one of another.
        """
        for table, prefix in self.tables.items():
            if table == self.main:
                key = key.removeprefix(prefix)
            else:
                at = at.removeprefix(prefix)
        return key, at

    def with_prefixes(self, key: str, at: str) -> tuple[str, str]:
        """A key and a position so that `without_prefixes` gives them: with the prefix where they
        begin as if they had it.
        """
        prefixes = {table: prefix for table, prefix in self.tables.items() if prefix}
        own = prefixes.pop(self.main, "")
        other = next(filter(at.startswith, prefixes.values()), "")
        return (f"{own}{key}" if own and key.startswith(own) else key), f"{other}{at}"

    def url_of(self, key: str) -> str:
        """The URL of an item at the service; "" where the key alone does not give one."""
        return self.address.format(key=key)


class Package(NamedTuple):
    """A package that brings a source: its folder, and the entry point of its class."""

    folder: Path
    entry_point: importlib.metadata.EntryPoint


def _installed() -> dict[str, Package]:
    """The packages that add a source, by its name."""
    packages = {}
    for entry_point in importlib.metadata.entry_points(group=ENTRY_POINTS):
        name = entry_point.module.partition(".")[0]
        spec = find_spec(name)
        if spec is None or not spec.submodule_search_locations:
            raise SettingError(
                f"the source {entry_point.name!r} is in {name!r}, which is no package",
                hint=f"correct the entry point {entry_point.value!r} of {ENTRY_POINTS}",
            )
        packages[entry_point.name] = Package(Path(spec.submodule_search_locations[0]), entry_point)
    return packages


INSTALLED = _installed()
SCHEMA_FOLDERS = [folder("schemas"), *(source.folder / "schemas" for source in INSTALLED.values())]

Declared = TypeVar("Declared", bound=Publication)


def load_declaration(path: Path, kind: type[Declared], **known: Any) -> Declared:
    """A declaration with what is `known` besides. Raises SettingError with the file and what is
    wrong in it.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        return msgspec.convert(
            {"name": path.stem, **known, **data}, kind, dec_hook=lambda _, value: value
        )
    except (OSError, ValueError) as error:  # not readable, no TOML, not what is declared
        raise SettingError(
            f"{path}: {error}", hint="correct the file, or uninstall the package that has it"
        ) from None


def _declared() -> Iterator[SourceDeclaration]:
    for path in (SCHEMA_FOLDERS[0] / "sources").glob("*.toml"):
        place = {"package": PACKAGES / path.stem, "module": f"kb.{path.stem}"}
        yield load_declaration(path, SourceDeclaration, **place)
    for name, package in INSTALLED.items():
        path = package.folder / "schemas" / "sources" / f"{name}.toml"
        place = {"package": package.folder, "module": package.entry_point.module.partition(".")[0]}
        yield load_declaration(path, SourceDeclaration, **place)


def _in_order(declarations: Iterable[Declared]) -> dict[str, Declared]:
    ordered = sorted(declarations, key=lambda declared: (declared.order, declared.name))
    return {declared.name: declared for declared in ordered}


SOURCES = _in_order(_declared())
MADE = _in_order(
    load_declaration(path, Publication)
    for path in (SCHEMA_FOLDERS[0] / "publications").glob("*.toml")
)
SELECTIONS = tuple(name for name in MADE if MADE[name].selected_from)


def selection_of(name: str) -> str:
    """The selection that has a name of its own: "draw" of "draw-small"; "" for any other name."""
    named = (one for one in SELECTIONS if name.startswith(f"{one}-") and len(name) > len(one) + 1)
    return next(named, "")


class _Publications(dict[str, Publication]):
    """By name; a selection with a name of its own is declared as the one without."""

    def __missing__(self, name: str) -> Publication:
        if not (selection := selection_of(name)):
            raise KeyError(name)
        return self[selection]


PUBLISHED: dict[str, Publication] = _Publications({**SOURCES, **MADE})

# Kinds of the passages of all sources; those of pages, which are about what their titles name; and
# what texts are called in links.
KINDS = tuple(dict.fromkeys(kind for source in SOURCES.values() for kind in source.kinds))
PAGES = tuple(
    kind for source in SOURCES.values() if source.shape == "page" for kind in source.kinds
)
PARTS = tuple(dict.fromkeys(part for source in SOURCES.values() for part in source.parts))

# What every release holds; the rest is there where the profile asks for it.
BY_DEFAULT = tuple(
    name for name, one in PUBLISHED.items() if not (one.part_of or one.selected_from)
)


def made_of(name: str) -> tuple[str, ...]:
    """The sources whose rows are behind what is published under that name."""
    return (name,) if name in SOURCES else PUBLISHED[name].made_of or tuple(SOURCES)


def position(url: SplitResult, name: str) -> tuple[str, str] | None:
    """The key and the position that a link to a source names."""
    place, text = SOURCES[name].place, urlunsplit(url)
    if not place.key:
        kept = [
            part for part in url.query.split("&") if part.partition("=")[0] not in place.ignored
        ]
        return urlunsplit(url._replace(query="&".join(kept), fragment="")), url.fragment
    key, at = re.search(place.key, text), place.at and re.search(place.at, text)
    return (key[1], at[1] if at else "") if key else None
