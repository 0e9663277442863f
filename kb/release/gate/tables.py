"""Checks that every released row is as its schema declares: names and types of the columns, values,
and no content where only ids may be. Compares released rows with the clean ones: their number,
their age, and whether every text has been scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import duckdb
import orjson
import pyarrow as pa

from kb.artifacts import manifest
from kb.artifacts.release_folder import TOMBSTONES, ReleasedTable, ReleaseFolder
from kb.core import clock
from kb.core.context import Run
from kb.core.errors import DamagedData
from kb.core.regular_file import read_regular
from kb.core.sources import PUBLISHED, SOURCES, made_of
from kb.release.folders import samples
from kb.release.gate import GateProblem, damaged
from kb.schema import Table, released_tables, table
from kb.schema.conformity import column_problems, value_problem
from kb.schema.tables import Column
from kb.store.artifact_registry import of_table
from kb.store.layout import Layout
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan, text_literal

_LONGEST_ID = 16  # characters of ids, types and full names; anything longer is content


def check(folder: ReleaseFolder) -> tuple[list[GateProblem], list[ReleasedTable]]:
    """Problems of Parquet files, samples and tombstones, and the tables that read as declared."""
    problems: list[GateProblem] = []
    readable = []
    for part in folder.parts:
        names = [shard.name for shard in part.shards]
        by_stem = {
            stem: [one for one in names if one.startswith(f"{stem}-")] for stem in part.table.stems
        }
        if not all(some and numbered(some, stem, "parquet") for stem, some in by_stem.items()):
            what = "shards are missing or of two exports; export it again"
            problems.append(GateProblem("damaged", f"{folder.source}/{part.table.short}", what))
        own = [
            problem for shard in part.shards for problem in _shard(shard, part.table, folder.source)
        ]
        if not any(problem.check in ("damaged", "undescribed") for problem in own):
            readable.append(part)
        problems += own
    files = [(declared, path) for declared, path in samples(folder)]
    if folder.path / TOMBSTONES in folder.files():
        files.insert(0, (table("shared/tombstones"), folder.path / TOMBSTONES))
    for declared, path in files:
        problems += _json(path, declared, folder.source)
    return problems, readable


def numbered(names: list[str], stem: str, ending: str) -> bool:
    """Whether `names` are all files of one export: 0 to n-1 of n."""
    total = len(names)
    return names == [f"{stem}-{index:05d}-of-{total:05d}.{ending}" for index in range(total)]


def _shard(path: Path, declared: Table, source: str) -> list[GateProblem]:
    """Problems of one Parquet file."""
    where = f"{source}/{path.name}"
    try:
        with parquet.open_stored(path) as file:
            schema = file.schema_arrow
            if problems := _columns(declared, schema, where):
                return problems
            with reading([path]):
                outside = dict(reversed([*parquet.value_problems(file, declared)]))
        problems = [GateProblem("undescribed", where, what) for what in outside.values()]
        columns = [column for column in declared.columns if column.released]
        with reading([path]), database.asking() as con:
            return problems + _values(con, scan([path]), columns, declared, where, source)
    except DamagedData as error:
        return [damaged(where, error, "export it again")]


def _json(path: Path, declared: Table, source: str) -> list[GateProblem]:
    """Problems of rows in JSON: a sample, which is a list of them, or tombstones, one a line."""
    where = f"{source}/{path.name}"
    try:
        data = read_regular(path)
        lines = path.suffix == ".ndjson"
        rows = [*map(orjson.loads, data.splitlines())] if lines else orjson.loads(data)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise ValueError("it is not a list of rows")
    except (ValueError, OSError) as error:
        return [damaged(where, error, "run `kb release` again")]
    names = dict.fromkeys(name for row in rows for name in row)
    schema = declared.arrow(True)
    there = [
        schema.field(name) if name in schema.names else pa.field(name, pa.null()) for name in names
    ]
    if rows and (undeclared := _columns(declared, pa.schema(there), where)):
        return undeclared
    problems, arrays = [], {}
    for field in declared.arrow(True):
        try:
            values = [row.get(field.name) for row in rows]
            if pa.types.is_timestamp(field.type):  # as ISO 8601
                values = [
                    None if bound is None else datetime.fromisoformat(bound) for bound in values
                ]
            arrays[field.name] = pa.array(values, field.type)
            if what := value_problem(declared.column(field.name), arrays[field.name]):
                problems.append(GateProblem("undescribed", where, what))
        except (pa.ArrowException, ValueError, TypeError, OverflowError):
            what = (
                f"column {field.name} contains other values than {declared.column(field.name).type}"
            )
            problems.append(GateProblem("undescribed", where, what))
    with database.asking() as con:
        con.register("rows", pa.table(arrays))
        columns = [declared.column(name) for name in arrays]
        return problems + _values(con, "rows", columns, declared, where, source)


def _columns(declared: Table, stored: pa.Schema, where: str) -> list[GateProblem]:
    """Columns that the schema does not declare or release, and those that are not as declared."""
    known = {column.name: column for column in declared.columns}
    problems = []
    for name in dict.fromkeys(stored.names):
        column = known.get(name)
        if column is None:
            what = f"column {name} is not described in schemas/"
            problems.append(GateProblem("undescribed", where, what))
        elif not column.released:
            kind = "content" if column.content else "unreleased"
            problems.append(GateProblem(kind, where, f"column {name} may not be released"))
    return problems + [
        GateProblem("undescribed", where, what)
        for _, what in column_problems(declared, stored, released=True)
    ]


def _values(
    con: duckdb.DuckDBPyConnection,
    rows: str,
    columns: list[Column],
    declared: Table,
    where: str,
    source: str,
) -> list[GateProblem]:
    """The first invalid value of each column, in one query; it may be content and is not shown."""
    ids_only = PUBLISHED[source].ids_only and declared.source == source
    rules = [(column, *rule) for column in columns for rule in _rules(column, ids_only=ids_only)]
    if not rules:
        return []
    asked = ", ".join(f"bool_or({invalid})" for _, _, invalid, _ in rules)
    row = con.execute(f"SELECT {asked} FROM {rows}").fetchone()
    problems: dict[str, GateProblem] = {}
    for (column, kind, _, what), invalid in zip(rules, row or (), strict=True):
        if invalid:
            text = f"column {column.name} {what}"
            problems.setdefault(column.name, GateProblem(kind, where, text))
    return [*problems.values()]


def _rules(column: Column, *, ids_only: bool) -> list[tuple[str, str, str]]:
    """Of a column: (kind of problem, SQL that is true for an invalid value, message)."""
    name = f'"{column.name}"'
    rules = []
    if not column.nullable:
        what = "has rows without a value, schemas/ says there are none; export it again"
        rules.append(("null", f"{name} IS NULL", what))
    if column.type != "string":
        return rules
    if ids_only:
        # No text of such a table may be longer than an id or hold an address, whatever its column
        # says.
        invalid = f"length({name}) > {_LONGEST_ID} OR regexp_matches({name}, '[\\s/@]')"
        rules.append(("content", invalid, "contains text that is not an id"))
    if column.values:
        allowed = ", ".join(text_literal(value) for value in column.values)
        what = f"contains other values than {', '.join(column.values)}"
        rules.append(("content", f"{name} NOT IN ({allowed})", what))
    if column.pattern:
        invalid = f"NOT regexp_full_match({name}, {text_literal(column.pattern)})"
        rules.append(("content", invalid, f"contains other values than {column.pattern}"))
    return rules


def check_rows(run: Run, folder: ReleaseFolder, readable: list[ReleasedTable]) -> list[GateProblem]:
    """Every problem of rows of `readable` tables; with damaged clean rows nothing is compared."""
    unfinished = [
        GateProblem(
            "removed",
            folder.source,
            f"a purge of {source} has not finished; run `kb purge {source}` again",
        )
        for source in made_of(folder.source)
        if Layout(run.root).purge(source).exists()
    ]
    if unfinished:  # rows that were to be removed may still be here
        return unfinished
    of = PUBLISHED[folder.source]
    if of.part_of or of.selected_from:  # of rows that other folders are checked for
        return []
    tables = released_tables(folder.source)
    problems = [problem for name in tables for problem in _damaged_clean(run.root, name)]
    if not problems:
        for part in readable:
            problems += _numbers(run.root, folder.source, part)
        problems += _unscored(run, folder, readable)
    exported = {part.table.name for part in folder.parts}
    problems += [
        GateProblem(
            "rows",
            f"{folder.source}/{declared.short}",
            "is clean but not exported; run the export again",
        )
        for declared in tables
        if declared.name not in exported and Layout(run.root).rows(declared.name)
    ]
    return problems + [problem for part in readable for problem in _age(run, folder.source, part)]


def _damaged_clean(root: Path, declared: Table) -> list[GateProblem]:
    """Clean files that can't be read."""
    problems = []
    try:
        manifest.check_complete(root, declared.name)
    except DamagedData as error:
        return [GateProblem("damaged", declared.name, f"{error}; {error.hint}")]
    for path in Layout(root).rows(declared.name):
        try:
            parquet.open_file(path).close()
        except DamagedData as error:
            where = str(path.relative_to(root))
            problems.append(damaged(where, error, of_table(declared.name).hint))
    return problems


def _numbers(root: Path, source: str, part: ReleasedTable) -> list[GateProblem]:
    released, clean = (
        sum(parquet.footer(path).num_rows for path in paths)
        for paths in (part.shards, Layout(root).rows(part.table.name))
    )
    if released == clean:
        return []
    what = f"{released:,} released, {clean:,} clean; run the export again"
    return [GateProblem("rows", f"{source}/{part.table.short}", what)]


def _age(run: Run, source: str, part: ReleasedTable) -> list[GateProblem]:
    """Rows that are older than the source's own limit, else the release's."""
    section = getattr(run.profile, source, None)
    days = getattr(section, "max_age_days", None) or run.profile.release.max_age_days
    if days is None or "fetched_at" not in part.table.names(released=True):
        return []
    limit = clock.now() - timedelta(days=days)
    # The terms of a service are about what it was asked for, not about files that people have.
    aging, names = PUBLISHED[source].aging, part.table.names(released=True)
    of_service = [f"{column} = '{value}'" for column, value in aging if column in names]
    if aging and not of_service:
        return []  # nothing says which of its rows are the service's
    asked = " OR ".join(of_service) or "true"
    with database.asking() as con:
        row = con.execute(
            "SELECT count(*), min(fetched_at)::DATE FROM read_parquet(?)"
            f" WHERE fetched_at < ? AND ({asked})",
            [[str(path) for path in part.shards], limit],
        ).fetchone()
    if not row or not row[0]:
        return []
    what = f"{row[0]:,} rows were read more than {days} days ago (the oldest on {row[1]})"
    if source in SOURCES and SOURCES[source].refreshed:
        what = f"{what}; run `kb refresh {source}`"
    return [GateProblem("age", f"{source}/{part.table.short}", what)]


def _unscored(run: Run, folder: ReleaseFolder, readable: list[ReleasedTable]) -> list[GateProblem]:
    """Texts without a toxicity score, in clean/ and as released."""
    if not run.profile.toxicity.on:
        return []  # the card says so
    shards = {part.table.name: part.shards for part in readable}
    problems = []
    for declared in released_tables(folder.source):
        where = f"{folder.source}/{declared.short}"
        clean = _count_unscored(Layout(run.root).rows(declared.name), {*declared.names()})
        command = f"run `kb {folder.source} filter` and `kb {folder.source} export` again"
        problems += [
            GateProblem(
                "toxicity", where, f"{rows:,} rows have no toxicity score of {text}; {command}"
            )
            for text, rows in clean.items()
        ]
        names = {*declared.names(released=True)}
        released = _count_unscored(shards.get(declared.name, ()), names)
        what = "released rows have no toxicity score of"
        problems += [
            GateProblem("toxicity", where, f"{rows:,} {what} {text}; run the export again")
            for text, rows in released.items()
            if rows > clean.get(text, 0)
        ]
    return problems


def _count_unscored(files: Sequence[Path], names: set[str]) -> dict[str, int]:
    """Text → rows with that text and without its score; `toxicity_<text>` belongs to `<text>`."""
    if not files:
        return {}
    texts = sorted(name for name in names if f"toxicity_{name}" in names)
    tests = {text: (f'length(trim("{text}")) > 0', f"toxicity_{text}") for text in texts}
    if {"toxicity", "word_count"} <= names:
        tests["the page's text"] = ("word_count > 0", "toxicity")
    counts = {}
    with database.asking() as con:
        for text, (present, score) in tests.items():
            # One after the other: where every row has a score, no text is read.
            row = con.execute(
                f'SELECT count(*) FROM read_parquet(?) WHERE "{score}" IS NULL AND {present}',
                [[str(path) for path in files]],
            ).fetchone()
            if row and row[0]:
                counts[text] = int(row[0])
    return counts
