"""Every text of clean/ → links/entities-*.parquet and links/links-*.parquet.

A part is a file of a clean table. The parts are merged into globally sorted files, which therefore
don't depend on workers or the engine.

Each entity has the wiki page with its title, else one whose redirect names it. Titles and redirects
are compared whole, folded as keywords are (case, punctuation, spaces). Of several pages that one
wins, in this order: whose title is the entity's name; whose redirect is; whose title is without
what stands in brackets behind it; then the same for the entity's other forms. Of equals one that is
written as the entity is, then the smallest id.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import domain_binding, manifest, texts
from kb.artifacts.parted_build import (
    Part,
    PartedBuild,
    is_current,
    parted_build,
    read_plan,
    write_part,
)
from kb.artifacts.table_catalog import NO_TABLES, Catalog
from kb.core import scripts
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.installation import np
from kb.core.sources import SOURCES
from kb.core.summary import Summary
from kb.links.texts import TextPart, TextSource, parts
from kb.pairs import keywords as lists
from kb.pairs.extract import PairCounts, matches
from kb.pairs.keywords import EXCLUDED, Keywords
from kb.pairs.matching import phrase
from kb.schema import table
from kb.schema.wiki_page import PageNames
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import sorted_shards, write_table

_PAGES = "wiki/pages"
# Those of links/links that tables of sources have under the same names.
ID_COLUMNS = ("video_id", "page_id", "post_id", "comment_id")

TITLE, ALIAS = "title", "alias"
_BRACKETS = re.compile(r"\s*\([^()]*\)$")

MENTION = "mention"


def build(
    run: Run, sources: Mapping[str, TextSource], names: Callable[[], Mapping[str, PageNames]]
) -> Summary:
    """Make the entity tables where they are not what clean/ says. `names`: what the wiki calls its
    pages, by title.

    The same input gives the same bytes. Raises ProfileError, MissingExtra, FatalError without
    clean tables, Interrupted, WriterLocked, DamagedData, DiskFull.
    """
    keywords = required_keywords(run)
    with domain_binding.writing(run, "links"):
        files, inputs = texts.files(run.root, "links"), texts.inputs(run.root, "links")
        called = names() if _PAGES in files else {}
        if is_current(run, "links"):
            run.progress.say("links are up to date")
            return _summary(run.root)
        own = own_pages(keywords, _titles(files.get(_PAGES, [])), called)
        paths = [(table, path) for table, paths in files.items() for path in paths]
        parts = [
            Part(
                f"{_stem(table)}.{path.stem}", (str(path), table, sources[table.partition("/")[0]])
            )
            for table, path in paths
        ]
        plan = {"keywords": lists.plain(keywords)}
        with parted_build(run, "links", inputs, plan) as parted:
            parted.make_parts(parts, make_part, "files", [path for _, path in paths])
            if _PAGES in files:
                _title_rows(parted.folder, keywords, own)
            _finish(parted, keywords, own)
    return _summary(run.root)


def required_keywords(run: Run) -> Keywords:
    """The profile's keywords, when everything else that links need is there.

    Raises ProfileError, FatalError without clean tables.
    """
    keywords = lists.load(run.profile)
    if not texts.files(run.root, "links"):
        raise FatalError(f"nothing to link: {run.root} has no texts", hint=NO_TABLES)
    return keywords


def _stem(table: str) -> str:
    return table.replace("/", ".")


def make_part(folder: str, name: str, path: str, table: str, of: TextSource) -> dict[str, int]:
    """The mentions in a file of a clean table."""
    keywords, (source, _, short) = _keywords(read_plan(folder)), table.partition("/")
    ids = _ids(Path(path), source, short)
    tables = [
        with_ids(mentions(source, part, keywords), ids) for part in parts(of, Path(path), short)
    ]
    write_part(folder, name, tables, "links/links", {})
    return {"links": sum(rows.num_rows for rows in tables)}


def _ids(path: Path, source: str, short: str) -> pa.Table:
    """What links/links says of the keys of a file: `key`, and each of its columns of ids that the
    table has.
    """
    declared = table(f"{source}/{short}")
    own = [name for name in ID_COLUMNS if name in declared.names()]
    with reading([path]):
        rows = parquet.read_table(path, columns=list(dict.fromkeys([declared.key[0], *own])))
    prefix = SOURCES[source].tables.get(short, "")
    keys = pc.binary_join_element_wise(prefix, rows[declared.key[0]].cast(pa.string()), "")
    return pa.table({"key": keys, **{name: rows[name] for name in own}})


def with_ids(links: pa.Table, ids: pa.Table) -> pa.Table:
    """Links with the ids that a table has for their keys."""
    keys = ids["key"].cast(pa.string()).combine_chunks()  # of no type where a table has no rows
    places = pc.index_in(links["key"].cast(pa.string()), value_set=keys)
    for name in ID_COLUMNS:
        kind = table("links/links").arrow().field(name).type
        known = ids[name].take(places) if name in ids.column_names else pa.nulls(len(links), kind)
        links = links.append_column(name, known.cast(kind))
    return links


@lru_cache(maxsize=2)
def _keywords(plan: str) -> Keywords:
    """The keywords of a plan with their automaton, made once in each worker."""
    return lists.of_plain(json.loads(plan)["keywords"])


def _titles(files: list[Path]) -> Iterator[tuple[int, str]]:
    for path in files:
        with reading([path]):
            pages = parquet.read_table(path, columns=["page_id", "title"])
        ids, titles = pages["page_id"].to_pylist(), pages["title"].to_pylist()
        yield from cast("Iterator[tuple[int, str]]", zip(ids, titles, strict=True))


def _title_rows(work: Path, keywords: Keywords, own: Mapping[int, Own]) -> None:
    """Own pages are linked as such, in the place of what their titles mention of the entity."""
    pages = [keywords.every[number].name for number in own]
    ids = [str(page.page_id) for page in own.values()]
    mine = pa.array([f"{page}\x1f{entity}" for page, entity in zip(ids, pages, strict=True)])
    for path in parquet_files(work, f"{_stem(_PAGES)}.*.parquet"):
        mentioned = parquet.read_table(path)
        both = pc.binary_join_element_wise(
            mentioned["key"].cast(pa.string()), mentioned["entity"].cast(pa.string()), "\x1f"
        )
        left = mentioned.filter(pc.invert(pc.is_in(both, value_set=mine.cast(pa.string()))))
        if left.num_rows < mentioned.num_rows:
            write_table(path, left, "links/links")
    own_rows = rows(
        _PAGES.partition("/")[0],
        "title",
        pa.array([page.how for page in own.values()], pa.string()),
        pa.array(pages, pa.string()),
        pa.array(ids, pa.string()),
        pa.array([page.names for page in own.values()], pa.int64()),
        pa.nulls(len(own), pa.float64()),
    )
    pages_of = pa.table({"key": ids, "page_id": [page.page_id for page in own.values()]})
    write_table(work / "own-pages.parquet", with_ids(own_rows, pages_of), "links/links")


def _finish(parted: PartedBuild, keywords: Keywords, own: Mapping[int, Own]) -> None:
    """Write the tables and the figures."""
    fresh = parted.build
    entities = pa.table(
        {
            "entity": keywords.names,
            "kind": pa.array([keyword.kind for keyword in keywords.every], pa.string()),
            "aliases": pa.array(aliases(keywords), pa.list_(pa.string())),
            "wiki_page_id": pa.array(
                [
                    own[number].page_id if number in own else None
                    for number in range(len(keywords.every))
                ],
                pa.int64(),
            ),
        }
    )
    write_table(fresh.folder / "entities-00000-of-00001.parquet", entities, "links/entities")
    made = sorted_shards(parted.rows, fresh.folder, "links/links", released=False)
    with database.asking() as con:
        counted = con.execute(
            f"SELECT source, count(*), sum(count)::BIGINT FROM {scan(part.path for part in made)}"
            " GROUP BY 1 ORDER BY 1"
        ).fetchall()
    fresh.figures = {
        "entities": len(keywords.every),
        "with_page": len(own),
        "links": sum(rows for _, rows, _ in counted),
        "mentions": sum(mentioned for _, _, mentioned in counted),
        "sources": {source: rows for source, rows, _ in counted},
    }


def _summary(root: Path) -> Summary:
    root = Catalog(root.absolute()).workplace
    made = manifest.read_manifest(root, "links")
    figures = made.figures if made is not None else {}
    shown = ("entities", "with_page", "links", "mentions", "sources")
    return Summary(
        {"command": "links", "source": "links"},
        **{name: figures[name] for name in shown},
        path=str(Layout(root).links),
    )


class Own(NamedTuple):
    """An entity's own page: `how` it bears the name, `names` of its titles and redirects do."""

    page_id: int
    how: str
    names: int


class _Claim(NamedTuple):
    """Why a page may be an entity's own; the smallest one wins."""

    form: bool  # not the name, another form
    way: int  # title, redirect, title without brackets
    spelt: bool  # not as the entity is
    page_id: int
    names: int


def own_pages(
    keywords: Keywords, pages: Iterable[tuple[int, str]], names: Mapping[str, PageNames]
) -> dict[int, Own]:
    """Entities (by number) that have a page of their own. `pages` are ids and titles; `names` says
    by title what else they are called.
    """
    owners = dict(zip(keywords.phrases, keywords.of, strict=True))
    first = [phrase(keyword.name) for keyword in keywords.every]
    best: dict[int, _Claim] = {}
    for page_id, title in pages:
        known = names.get(title, PageNames(title))
        claims: dict[int, _Claim] = {}
        for way, name in (
            (0, known.title),
            *((1, redirect) for redirect in known.redirects),
            (2, _BRACKETS.sub("", known.title)),
        ):
            folded = phrase(name)
            number = owners.get(folded, EXCLUDED)
            if number == EXCLUDED or (way == 2 and name == known.title):
                continue
            form, spelt = folded != first[number], name != keywords.every[number].name
            claim = _Claim(form, way, spelt, page_id, 1)
            known_claim = claims.get(number)
            if known_claim is not None:
                claim = min(claim, known_claim)._replace(names=known_claim.names + 1)
            claims[number] = claim
        for number, claim in claims.items():
            best[number] = min(best.get(number, claim), claim)
    return {
        number: Own(
            best_page.page_id,
            ALIAS if best_page.form or best_page.way == 1 else TITLE,
            best_page.names,
        )
        for number, best_page in sorted(best.items())
    }


def aliases(keywords: Keywords) -> list[list[str]]:
    """The other forms of each entity, sorted."""
    other_forms: list[list[str]] = [[] for _ in keywords.every]
    first = [phrase(keyword.name) for keyword in keywords.every]
    for form, number in zip(keywords.phrases, keywords.of, strict=True):
        if number != EXCLUDED and form != first[number]:
            other_forms[number].append(scripts.closed(form))
    return [sorted(forms) for forms in other_forms]


def mentions(source: str, part: TextPart, keywords: Keywords) -> pa.Table:
    """Rows of a part of a source's texts, in no order that matters."""
    text = part.text
    hits = matches(text, keywords, PairCounts())
    if part.timed:  # what is said when the video is over makes no pair either
        hits = hits.take(~text.beyond[text.cue_of(hits.start)])
    pair = hits.keyword * len(text) + hits.video
    order = np.argsort(pair, kind="stable")
    ordered = pair[order]
    heads = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1]))[: len(ordered)])
    counts = np.diff(np.append(heads, len(ordered)))
    first: pa.Array[Any] = pa.nulls(len(heads), pa.float64())
    if part.timed and len(heads):
        ms: np.ndarray = np.minimum.reduceat(text.time_of(hits.start[order]), heads)
        first = pa.array(ms / 1000)
    keyword, video = np.divmod(ordered[heads], max(len(text), 1))
    return rows(
        source,
        part.part,
        MENTION,
        keywords.names.take(pa.array(keyword)),
        text.ids.take(pa.array(video)).cast(pa.string()),
        pa.array(counts, pa.int64()),
        first,
    )


def rows(
    source: str,
    part: str,
    how: str | pa.Array[Any],
    entities: pa.Array[Any],
    keys: pa.Array[Any],
    counts: pa.Array[Any],
    first: pa.Array[Any],
) -> pa.Table:
    """Columns of links/links; `how` for all of them or each."""
    ways = pa.array([how] * len(keys), pa.string()) if isinstance(how, str) else how
    return pa.table(
        {
            "entity": entities,
            "source": pa.array([source] * len(keys), pa.string()),
            "key": keys,
            "part": pa.array([part] * len(keys), pa.string()),
            "how": ways,
            "count": counts,
            "first_at_s": first,
        }
    )
