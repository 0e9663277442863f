"""Every text of clean/ → links/entities-*.parquet and links/links-*.parquet.

A task is a file of a clean table; what it gave is kept under `state/links/` until all are done, so
that a run that was stopped goes on. The parts are merged into globally sorted files, which
therefore don't depend on workers or the engine. Rows of a source whose clean files, keywords and
names are those of the last time are taken over from it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import msgspec
import pyarrow as pa
import pyarrow.compute as pc

from kb.artifacts import linked, manifest
from kb.artifacts.catalog import NO_TABLES, Catalog
from kb.artifacts.linked import LinksNote, Read
from kb.core.context import Run
from kb.core.engine import make_executor, map_in_order
from kb.core.errors import FatalError, MissingExtra
from kb.core.installation import install_extra
from kb.core.sources import SOURCES, SPECS
from kb.core.verdict import Summary
from kb.links import entity_pages
from kb.links.entity_pages import Names, Own
from kb.links.mentions import MENTION, Finder, finder, mentions, rows
from kb.links.texts import TABLES, parts
from kb.pairs import keywords as lists
from kb.pairs.keywords import Keywords
from kb.store import parquet
from kb.store.atomic import replacing_folder, write_bytes, write_text
from kb.store.layout import Layout, parquet_files
from kb.store.lock import writer
from kb.store.reading import reading
from kb.store.shards import ShardWriter, sorted_shards, write_table

_RULES = "1"  # raised when the same input gives other rows
_PLAN = "plan.json"
PAGES = next(name for name, spec in SPECS.items() if spec.pages)  # whose pages are entities' own
Files = dict[str, dict[str, Path]]  # by source and "<table>/<name>"


def build(run: Run, names: Callable[[], Mapping[str, Names]]) -> Summary:
    """Make the entity tables where they are not what clean/ says. `names`: what the wiki calls its
    pages, by title.

    The same input gives the same bytes. Raises ProfileError, MissingExtra, FatalError without
    clean tables, Interrupted, WriterLocked, DamagedData, DiskFull.
    """
    keywords = check(run)
    place = Catalog(run.root.absolute()).workplace
    with writer(place, "links"):
        files = _files(run.root)
        called = names() if PAGES in files else {}
        reads = _reads(files, keywords, called)
        known = None if run.again else linked.read(run.root)
        if known is not None and _marks(known.sources) == _marks(reads):
            shutil.rmtree(Layout(place).linking, ignore_errors=True)
            run.progress.say("links are up to date")
            return _summary(place, known)
        work = _work(run, place, reads)
        write_text(work / _PLAN, json.dumps(lists.plain(keywords), sort_keys=True))
        own = entity_pages.own_pages(keywords, _titles(files.get(PAGES, {})), called)
        taken = [one for one in reads if known is not None and _same(known, reads, one)]
        if taken:
            _take_over(place, work, taken)
        _match(run, work, {one: held for one, held in files.items() if one not in taken})
        if PAGES in files and PAGES not in taken:
            _title_rows(work, keywords, own)
        note = _finish(run, place, work, keywords, own, reads)
        shutil.rmtree(Layout(place).linking)
    return _summary(place, note)


def check(run: Run) -> Keywords:
    """The profile's keywords, when everything else that links need is there.

    Raises ProfileError, MissingExtra, FatalError without clean tables.
    """
    keywords = lists.load(run.profile)
    if find_spec("numpy") is None:
        raise MissingExtra("links need the package numpy", hint=install_extra("pairs"))
    _files(run.root)
    return keywords


def _files(root: Path) -> Files:
    """The files of every source that has any: clean, else restored, else released ones.

    Raises FatalError, DamagedData.
    """
    catalog = Catalog(root.absolute())
    found: Files = {}
    for source in SOURCES:
        held = {
            f"{name}/{path.name}": path
            for name in TABLES[source]
            for path in catalog.texts(f"{source}/{name}")
        }
        if held:
            found[source] = held
    if not found:
        raise FatalError(f"nothing to link: {root} has no texts", hint=NO_TABLES)
    return found


def _reads(files: Files, keywords: Keywords, called: Mapping[str, Names]) -> dict[str, Read]:
    rules = json.dumps([_RULES, lists.plain(keywords)], sort_keys=True)
    found = {}
    for source, held in files.items():
        digests = {name: parquet.content_digest(path) for name, path in held.items()}
        said = sorted(called.items()) if source == PAGES else []
        whole = json.dumps([rules, sorted(digests.items()), said])
        mark = hashlib.sha256(whole.encode()).hexdigest()[:16]
        found[source] = Read(mark, digests, 0)
    return found


def _marks(reads: Mapping[str, Read]) -> dict[str, str]:
    return {source: one.mark for source, one in reads.items()}


def _same(known: LinksNote, reads: Mapping[str, Read], source: str) -> bool:
    return source in known.sources and known.sources[source].mark == reads[source].mark


def _work(run: Run, place: Path, reads: Mapping[str, Read]) -> Path:
    """The folder of what is done so far of these very files; those of others go."""
    mark = hashlib.sha256(json.dumps(_marks(reads)).encode()).hexdigest()[:16]
    work = Layout(place).linking / mark
    for other in Layout(place).linking.glob("*"):
        if other != work or run.again:
            shutil.rmtree(other, ignore_errors=True)
    return work


def _take_over(root: Path, work: Path, sources: list[str]) -> None:
    """The rows of sources that are as they were, in one part."""
    wanted = pa.array(sources, pa.string())
    files = manifest.rows(root, "links/links")
    with reading(files), ShardWriter(work / "taken.parquet", "links/links", in_order=True) as out:
        for path in files:
            with parquet.open_file(path, pre_buffer=False) as file:
                for batch in file.iter_batches():
                    mine = pc.is_in(batch.column("source").cast(pa.string()), value_set=wanted)
                    out.write(pa.Table.from_batches([batch.filter(mine)]))


def _match(run: Run, work: Path, files: Files) -> None:
    """A part for each clean file that has none yet."""
    todo = [
        (str(work), str(path), f"{source}/{name.partition('/')[0]}")
        for source, held in files.items()
        for name, path in held.items()
        if not _part(work, source, name).exists()
    ]
    size = sum(Path(path).stat().st_size for _, path, _ in todo)
    with (
        run.progress.task("links", total=len(todo), unit="files") as task,
        make_executor(run.engine, run.processes(size), run.scheduler) as executor,
    ):
        for count in map_in_order(executor, do_file, iter(todo), window=2 * run.workers):
            task.advance(1, links=count)


def _part(work: Path, source: str, name: str) -> Path:
    return work / f"{source}.{name.replace('/', '.')}"


def do_file(work: str, path: str, table: str) -> int:
    """One task: the mentions in a clean file; how many rows."""
    source, _, short = table.partition("/")
    with_ = _finder(f"{work}/{_PLAN}")
    found = [mentions(source, part, with_) for part in parts(Path(path), table)]
    out = _part(Path(work), source, f"{short}/{Path(path).name}")
    write_table(out, pa.concat_tables(found) if found else _none(), "links/links")
    return sum(one.num_rows for one in found)


@lru_cache(maxsize=2)
def _finder(plan: str) -> Finder:
    """The automaton of a plan, made once in each worker."""
    return finder(lists.of_plain(json.loads(Path(plan).read_text())))


def _none() -> pa.Table:
    text = pa.array([], pa.string())
    none = pa.array([], pa.int64())
    return rows("", "", MENTION, text, text, none, pa.array([], pa.float64()))


def _titles(files: Mapping[str, Path]) -> Iterator[tuple[int, str]]:
    for name, path in files.items():
        if name.startswith("pages/"):
            with reading([path]):
                held = parquet.read_table(path, columns=["page_id", "title"])
            ids, titles = held["page_id"].to_pylist(), held["title"].to_pylist()
            yield from cast("Iterator[tuple[int, str]]", zip(ids, titles, strict=True))


def _title_rows(work: Path, keywords: Keywords, own: Mapping[int, Own]) -> None:
    """Own pages are linked as such, in the place of what their titles mention of the entity."""
    pages = [keywords.every[number].name for number in own]
    ids = [str(one.page_id) for one in own.values()]
    mine = pa.array([f"{page}\x1f{entity}" for page, entity in zip(ids, pages, strict=True)])
    for path in parquet_files(work, f"{PAGES}.pages.*"):
        held = parquet.read_table(path)
        both = pc.binary_join_element_wise(
            held["key"].cast(pa.string()), held["entity"].cast(pa.string()), "\x1f"
        )
        left = held.filter(pc.invert(pc.is_in(both, value_set=mine.cast(pa.string()))))
        if left.num_rows < held.num_rows:
            write_table(path, left, "links/links")
    found = rows(
        PAGES,
        "title",
        pa.array([one.how for one in own.values()], pa.string()),
        pa.array(pages, pa.string()),
        pa.array(ids, pa.string()),
        pa.array([one.names for one in own.values()], pa.int64()),
        pa.nulls(len(own), pa.float64()),
    )
    write_table(work / f"{PAGES}.own.parquet", found, "links/links")


def _finish(
    run: Run,
    place: Path,
    work: Path,
    keywords: Keywords,
    own: Mapping[int, Own],
    reads: dict[str, Read],
) -> LinksNote:
    """Merge what is done into links/, with the note beside it."""
    size = run.profile.release.rows_per_shard
    with replacing_folder(Layout(place).links) as fresh:
        every = pa.table(
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
        write_table(fresh / "entities-00000-of-00001.parquet", every, "links/entities")
        made = sorted_shards(
            parquet_files(work), fresh, "links/links", rows_per_shard=size, released=False
        )
        counted, total = _counted([one.path for one in made])
        sources = {
            name: msgspec.structs.replace(one, links=counted.get(name, 0))
            for name, one in reads.items()
        }
        note = LinksNote(len(keywords.every), len(own), sum(counted.values()), total, sources)
        write_bytes(
            fresh / manifest.SUMMARY, msgspec.json.format(msgspec.json.encode(note), indent=1)
        )
        manifest.record(fresh, "links")
    return note


def _counted(files: list[Path]) -> tuple[dict[str, int], int]:
    """Rows by source, and mentions of all."""
    found: dict[str, int] = {}
    total = 0
    for path in files:
        with parquet.open_file(path, pre_buffer=False) as file:
            for batch in file.iter_batches(columns=["source", "count"]):
                held: list[dict[str, Any]] = pc.value_counts(batch.column(0)).to_pylist()
                for one in held:
                    found[one["values"]] = found.get(one["values"], 0) + one["counts"]
                total += pc.sum(batch.column(1)).as_py() or 0
    return found, total


def _summary(root: Path, note: LinksNote) -> Summary:
    return Summary(
        {"command": "links", "source": "links"},
        entities=note.entities,
        with_page=note.with_page,
        links=note.links,
        mentions=note.mentions,
        sources={name: one.links for name, one in note.sources.items()},
        path=str(Layout(root).links),
    )
