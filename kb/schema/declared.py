"""What is wrong with the declaration of a source: a contradiction, or a name of nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import permutations

from kb.core.errors import KbError
from kb.core.sources import SourceDeclaration
from kb.schema import raw
from kb.schema.answer_keys import keys_of
from kb.schema.tables import Table, tables

_NOT_RAW = ("envelope", "annotation", "rule")


def problems(source: SourceDeclaration, settings: Collection[str]) -> Iterator[str]:
    """Each with its file below the source's `schemas/`. `settings` are the known ones."""
    file = f"sources/{source.name}.toml"
    try:
        declared = {name: table for name, table in tables().items() if table.source == source.name}
        for kind in raw.kinds():
            if kind.startswith(f"{source.name}/"):
                keys_of(kind)
    except KbError as error:  # says itself in which file
        yield str(error)
        return
    shorts = {table.short for table in declared.values()}
    for key in ("tables", "linked", "indexed", "textual"):
        for short in getattr(source, key):
            if short not in shorts:
                yield f"{file}: `{key}` names {short}, but there is no tables/{source.name}/{short}"
    for name in (*source.shown, *source.sampled):
        if name not in declared:
            yield f"{file}: it shows {name}, but there is no tables/{name}.toml"
    for tables_of, words in (("linked", "parts"), ("indexed", "kinds")):
        if getattr(source, tables_of) and not getattr(source, words):
            yield f"{file}: `{tables_of}` has tables, but `{words}` says nothing"
    if source.main not in source.tables:
        yield f"{file}: `main` is {source.main}, which is not in [tables]"
    for (short, prefix), (other, longer) in permutations(source.tables.items(), 2):
        if longer.startswith(prefix):
            yield f"{file}: a key of {other} ({longer}…) may be one of {short} ({prefix}…)"
    if source.counted not in source.nouns.values():
        yield f"{file}: `counted` is {source.counted}, which is in no line of [nouns]"
    item = f"{source.name}/{source.main}"
    if source.restored and item in declared:
        (key, *_) = declared[item].key
        for short in source.tables.keys() & shorts:
            if key not in declared[f"{source.name}/{short}"].names():
                yield f"{file}: `restored` needs the column {key} in tables/{source.name}/{short}"
    if source.refreshed and source.refreshed not in source.nouns:
        yield f"{file}: `refreshed` is {source.refreshed}, which is not in [nouns]"
    for name in (source.credential, source.service.key if source.service else ""):
        if name and name not in settings:
            yield f"{file}: it needs the setting {name}, but there is no [settings.{name}]"


def package_problems(source: SourceDeclaration) -> Iterator[str]:
    """What else is wrong with a package, whose tables come from its own raw answers alone."""
    for part in ("about.toml", "pipeline.py", "section.py"):
        if not (source.package / part).is_file():
            yield f"there is no {source.package / part}"
    for declared in tables().values():
        if declared.source == source.name:
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
