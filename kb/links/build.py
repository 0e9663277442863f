"""Every text of clean/ → links/entities-*.parquet and links/links-*.parquet.

A part is a file of a clean table. The parts are merged into globally sorted files, which therefore
don't depend on workers or the engine. Rows of a source whose texts, keywords and names have not
changed are copied from the tables as they are.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import manifest, texts
from kb.artifacts.manifest import Build
from kb.artifacts.resumable_build import Part, PartedBuild, read_plan, write_part
from kb.artifacts.table_catalog import NO_TABLES, Catalog
from kb.core.context import Run
from kb.core.errors import FatalError
from kb.core.installation import require
from kb.core.summary import Summary
from kb.links import entity_pages
from kb.links.entity_pages import Names, Own
from kb.links.mentions import Finder, finder, mentions, rows
from kb.links.texts import parts
from kb.pairs import keywords as lists
from kb.pairs.keywords import Keywords
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import ShardWriter, sorted_shards, write_table

_LAYOUT = 1  # raised when the same input gives other rows
_PAGES = "wiki/pages"


def build(run: Run, names: Callable[[], Mapping[str, Names]]) -> Summary:
    """Make the entity tables where they are not what clean/ says. `names`: what the wiki calls its
    pages, by title.

    The same input gives the same bytes. Raises ProfileError, MissingExtra, FatalError without
    clean tables, Interrupted, WriterLocked, DamagedData, DiskFull.
    """
    keywords = check(run)
    with writer(Catalog(run.root.absolute()).workplace, "links"):
        files, inputs = texts.files(run.root, "links"), texts.inputs(run.root, "links")
        called = names() if _PAGES in files else {}
        plan = {
            "layout": _LAYOUT,
            "keywords": lists.plain(keywords),
            "names": sorted(called.items()),
        }
        parted = PartedBuild(run, "links", inputs, plan)
        if parted.is_current():
            run.progress.say("links are up to date")
            return _summary(parted.root)
        parted.begin()
        own = entity_pages.own_pages(keywords, _titles(files.get(_PAGES, [])), called)
        marks = _marks(inputs, plan)
        known = parted.known()
        before = known.figures.get("marks", {}) if known is not None else {}
        same = [source for source in marks if before.get(source) == marks[source]]
        if same:
            _copy(parted, same)
        todo = [
            (table, path)
            for table, paths in files.items()
            for path in paths
            if table.partition("/")[0] not in same
        ]
        made = [Part(f"{_stem(table)}.{path.stem}", (str(path), table)) for table, path in todo]
        parted.make(made, make_part, "files", [path for _, path in todo])
        if any(table == _PAGES for table, _ in todo):
            _title_rows(parted.folder, keywords, own)
        with parted.finish() as fresh:
            _finish(parted, fresh, keywords, own)
            fresh.figures["marks"] = marks
    return _summary(parted.root)


def check(run: Run) -> Keywords:
    """The profile's keywords, when everything else that links need is there.

    Raises ProfileError, MissingExtra, FatalError without clean tables.
    """
    keywords = lists.load(run.profile)
    require("pairs", "numpy")
    if not texts.files(run.root, "links"):
        raise FatalError(f"nothing to link: {run.root} has no texts", hint=NO_TABLES)
    return keywords


def _marks(inputs: Mapping[str, str], plan: Mapping[str, Any]) -> dict[str, str]:
    """A digest of everything that decides the rows of each source."""
    marks = {}
    for name, digest in inputs.items():
        source = name.partition("/")[2]
        mine = plan if _PAGES.startswith(f"{source}/") else {**plan, "names": []}
        encoded = json.dumps([digest, mine], sort_keys=True)
        marks[source] = hashlib.sha256(encoded.encode()).hexdigest()[:16]
    return marks


def _copy(parted: PartedBuild, sources: list[str]) -> None:
    """The rows of sources that have not changed, in one part."""
    wanted = pa.array(sources, pa.string())
    files = manifest.rows(parted.root, "links/links")
    out = parted.folder / "copied.parquet"
    with reading(files), ShardWriter(out, "links/links", in_order=True) as copied:
        for path in files:
            with parquet.open_file(path, pre_buffer=False) as file:
                for batch in file.iter_batches():
                    mine = pc.is_in(batch.column("source").cast(pa.string()), value_set=wanted)
                    copied.write(pa.Table.from_batches([batch.filter(mine)]))


def _stem(table: str) -> str:
    return table.replace("/", ".")


def make_part(folder: str, name: str, path: str, table: str) -> dict[str, int]:
    """The mentions in a file of a clean table."""
    with_ = _finder(folder)
    tables = [mentions(table.partition("/")[0], part, with_) for part in parts(Path(path), table)]
    write_part(folder, name, tables, "links/links", {})
    return {"links": sum(one.num_rows for one in tables)}


@lru_cache(maxsize=2)
def _finder(folder: str) -> Finder:
    """The automaton of a plan, made once in each worker."""
    return finder(lists.of_plain(read_plan(folder)["keywords"]))


def _titles(files: list[Path]) -> Iterator[tuple[int, str]]:
    for path in files:
        with reading([path]):
            pages = parquet.read_table(path, columns=["page_id", "title"])
        ids, titles = pages["page_id"].to_pylist(), pages["title"].to_pylist()
        yield from cast("Iterator[tuple[int, str]]", zip(ids, titles, strict=True))


def _title_rows(work: Path, keywords: Keywords, own: Mapping[int, Own]) -> None:
    """Own pages are linked as such, in the place of what their titles mention of the entity."""
    pages = [keywords.every[number].name for number in own]
    ids = [str(one.page_id) for one in own.values()]
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
        pa.array([one.how for one in own.values()], pa.string()),
        pa.array(pages, pa.string()),
        pa.array(ids, pa.string()),
        pa.array([one.names for one in own.values()], pa.int64()),
        pa.nulls(len(own), pa.float64()),
    )
    write_table(work / "own-pages.parquet", own_rows, "links/links")


def _finish(parted: PartedBuild, fresh: Build, keywords: Keywords, own: Mapping[int, Own]) -> None:
    """Write the tables and the figures."""
    entities = pa.table(
        {
            "entity": pa.array([one.name for one in keywords.every], pa.string()),
            "kind": pa.array([one.kind for one in keywords.every], pa.string()),
            "aliases": pa.array(entity_pages.aliases(keywords), pa.list_(pa.string())),
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
            f"SELECT source, count(*), sum(count)::BIGINT FROM {scan(one.path for one in made)}"
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
    made = manifest.read(root, "links")
    figures = made.figures if made is not None else {}
    shown = ("entities", "with_page", "links", "mentions", "sources")
    return Summary(
        {"command": "links", "source": "links"},
        **{name: figures[name] for name in shown},
        path=str(Layout(root).links),
    )
