"""`data.search(words)`: ranked answers from the indexes of the loaded folders."""

import msgspec
import pyarrow as pa

from kb.artifacts import domain_binding, texts
from kb.artifacts.table_catalog import Catalog
from kb.core.config.profile import DEFAULT, load_profile
from kb.core.config.settings import Settings
from kb.core.context import Run
from kb.core.errors import UsageError
from kb.core.search_hit import SearchHit
from kb.core.sources import KINDS, SOURCES
from kb.reader.tables import OpenTables, QueryResult
from kb.search.answers import search
from kb.search.build import ensure
from kb.search.ranking import Only

_NUMBERS = ("score", "start_s")
_SCHEMA = pa.schema(
    [
        pa.field(name, pa.float64() if name in _NUMBERS else pa.string())
        for name in SearchHit.__struct_fields__
    ]
)


def find(
    opened: OpenTables,
    words: str,
    sources: tuple[str, ...],
    only: Only,
    size: int = 1000,
    entity: str = "",
) -> QueryResult:
    """The answers as rows, best first. Builds indexes that are missing.

    Raises UsageError if there are no texts, WriterLocked, DamagedData, DiskFull.
    """
    for what, given, known in (("source", sources, SOURCES), ("kind", only.kinds, KINDS)):
        if wrong := [name for name in given if name not in known]:
            raise UsageError(f"unknown {what} {wrong[0]!r}", hint=f"use one of {', '.join(known)}")
    if not opened.catalogs:
        raise UsageError("a release at an address can't be searched", hint="download it first")
    hits = []
    chosen = sources or tuple(SOURCES)
    indexable = [
        catalog
        for catalog in opened.catalogs
        if any(texts.files(catalog.path, f"index/{name}") for name in chosen)
    ]
    for catalog in indexable or opened.catalogs:
        ensure(_run(catalog), chosen)
        hits += search(catalog.path, words, sources=sources, only=only, size=size, entity=entity)
    hits.sort(key=lambda hit: -hit.score)
    rows = [msgspec.to_builtins(hit) for hit in hits[: only.limit]]
    return QueryResult(pa.Table.from_pylist(rows, schema=_SCHEMA))


def _run(catalog: Catalog) -> Run:
    """A run with the folder's own profile, as indexing needs."""
    bound = domain_binding.remembered(catalog.path)
    if bound is not None:
        profile = domain_binding.load(catalog.path, bound)[0]
    else:
        profile = load_profile(domain_binding.profile_of(catalog.path) or DEFAULT)
    return Run(settings=Settings(kb_data=catalog.path), profile=profile, root=catalog.path)
