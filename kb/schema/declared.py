"""What is wrong with the declaration of a source: a contradiction, or a name of nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import permutations

from kb.core.errors import KbError
from kb.core.sources import SourceDeclaration
from kb.schema import raw
from kb.schema.answer_keys import keys_of
from kb.schema.tables import Table, tables_of

_NOT_RAW = ("envelope", "annotation", "rule")


def problems(source: SourceDeclaration, settings: Collection[str]) -> Iterator[str]:
    """Each with its file below the source's `schemas/`. `settings` are the known ones."""
    file = f"sources/{source.name}.toml"
    try:
        declared = {table.name: table for table in tables_of(source.name)}
        for kind in raw.kinds():
            if kind.startswith(f"{source.name}/"):
                keys_of(kind)
    except KbError as error:  # says itself in which file
        yield str(error)
        return
    for problem in (
        *_missing_names(source, settings, declared),
        *_contradictions(source, declared),
    ):
        yield f"{file}: {problem}"


def _missing_names(
    source: SourceDeclaration, settings: Collection[str], declared: Mapping[str, Table]
) -> Iterator[str]:
    """Names of tables, nouns and settings that are nowhere declared."""
    for key in ("tables", "linked", "indexed", "textual"):
        for short in getattr(source, key):
            if f"{source.name}/{short}" not in declared:
                yield f"`{key}` names {short}, but there is no tables/{source.name}/{short}"
    for name in (*source.shown, *source.sampled):
        if name not in declared:
            yield f"it shows {name}, but there is no tables/{name}.toml"
    if source.main not in source.tables:
        yield f"`main` is {source.main}, which is not in [tables]"
    if source.counted not in source.nouns.values():
        yield f"`counted` is {source.counted}, which is in no line of [nouns]"
    if source.refreshed and source.refreshed not in source.nouns:
        yield f"`refreshed` is {source.refreshed}, which is not in [nouns]"
    for name in (source.credential, source.service.key if source.service else ""):
        if name and name not in settings:
            yield f"it needs the setting {name}, but there is no [settings.{name}]"


def _contradictions(source: SourceDeclaration, declared: Mapping[str, Table]) -> Iterator[str]:
    """What is declared in one place and makes no sense with what stands in another."""
    for listed, words in (("linked", "parts"), ("indexed", "kinds")):
        if getattr(source, listed) and not getattr(source, words):
            yield f"`{listed}` has tables, but `{words}` says nothing"
    for (short, prefix), (other, longer) in permutations(source.tables.items(), 2):
        if longer.startswith(prefix):
            yield f"a key of {other} ({longer}…) may be one of {short} ({prefix}…)"
    item = declared.get(f"{source.name}/{source.main}")
    if source.restored and item is not None:
        own = (declared.get(f"{source.name}/{short}") for short in source.tables)
        for table in filter(None, own):
            if item.key[0] not in table.names():
                yield f"`restored` needs the column {item.key[0]} in tables/{table.name}"


def package_problems(source: SourceDeclaration) -> Iterator[str]:
    """What else is wrong with a package, whose tables come from its own raw answers alone."""
    for part in ("about.toml", "pipeline.py", "section.py"):
        if not (source.package / part).is_file():
            yield f"there is no {source.package / part}"
    for declared in tables_of(source.name):
        yield from _of_table(declared)


def _of_table(declared: Table) -> Iterator[str]:
    """Columns that come from where nothing is."""
    kinds = [kind.partition("/")[2] for kind in raw.kinds() if kind.startswith(declared.source)]
    for column in (*declared.columns, *declared.inputs):
        where = f"tables/{declared.name}.toml: column {column.name}"
        for origin in (column.source, *column.also):
            if origin.kind in _NOT_RAW:
                continue
            if origin.kind not in kinds:
                yield f"{where}: there is no raw/{declared.source}/{origin.kind}.json"
            elif raw.at(f"{declared.source}/{origin.kind}", origin.path) is None:
                yield f"{where}: raw/{declared.source}/{origin.kind}.json has no {origin.path}"
