"""Checks that every released row is as its schema declares: names and types of the columns, values,
and no content where only ids may be.
"""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime
from pathlib import Path

import duckdb
import orjson
import pyarrow as pa

from kb.artifacts.release_folder import TOMBSTONES, ReleasedTable, ReleaseFolder
from kb.core.errors import DamagedData
from kb.core.sources import PUBLISHED
from kb.release.folders import samples
from kb.release.gate import GateProblem, damaged
from kb.schema import Table, table
from kb.schema.tables import Column
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan

_LONGEST_ID = 16  # characters of ids, types and full names; anything longer is content


def check(folder: ReleaseFolder) -> tuple[list[GateProblem], list[ReleasedTable]]:
    """Problems of Parquet files, samples and tombstones, and the tables that read as declared."""
    problems: list[GateProblem] = []
    readable = []
    for part in folder.parts:
        names = [shard.name for shard in part.shards]
        if not numbered(names, part.table.short, "parquet"):
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
        with parquet.open_file(path) as file:
            schema = file.schema_arrow
        problems = _columns(declared, schema.names, where)
        for field in declared.arrow(True):
            if field.name in schema.names and schema.field(field.name).type != field.type:
                what = (
                    f"column {field.name} is {schema.field(field.name).type}, schemas/ says"
                    f" {declared.column(field.name).type}"
                )
                problems.append(GateProblem("undescribed", where, what))
        if problems:
            return problems
        columns = [column for column in declared.columns if column.released]
        with reading([path]), database.asking() as con:
            return _values(con, scan([path]), columns, declared, where, source)
    except DamagedData as error:
        return [damaged(where, error, "export it again")]


def _json(path: Path, declared: Table, source: str) -> list[GateProblem]:
    """Problems of rows in JSON: a sample, which is a list of them, or tombstones, one a line."""
    where = f"{source}/{path.name}"
    try:
        data = path.read_bytes()
        lines = path.suffix == ".ndjson"
        rows = [*map(orjson.loads, data.splitlines())] if lines else orjson.loads(data)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise ValueError("it is not a list of rows")
    except (ValueError, OSError) as error:
        return [damaged(where, error, "run `kb release` again")]
    names = dict.fromkeys(name for row in rows for name in row)
    if rows and (undeclared := _columns(declared, names, where)):
        return undeclared
    problems, arrays = [], {}
    for field in declared.arrow(True):
        try:
            values = [row.get(field.name) for row in rows]
            if pa.types.is_timestamp(field.type):  # as ISO 8601
                values = [None if one is None else datetime.fromisoformat(one) for one in values]
            arrays[field.name] = pa.array(values, field.type)
        except (pa.ArrowException, ValueError, TypeError, OverflowError):
            what = (
                f"column {field.name} contains other values than {declared.column(field.name).type}"
            )
            problems.append(GateProblem("undescribed", where, what))
    with database.asking() as con:
        con.register("rows", pa.table(arrays))
        columns = [declared.column(name) for name in arrays]
        return problems + _values(con, "rows", columns, declared, where, source)


def _columns(declared: Table, names: Collection[str], where: str) -> list[GateProblem]:
    """Columns that the schema does not declare or release, and those that are missing."""
    known = {column.name: column for column in declared.columns}
    expected = declared.names(released=True)
    problems = []
    for name in names:
        column = known.get(name)
        if column is None:
            what = f"column {name} is not described in schemas/"
            problems.append(GateProblem("undescribed", where, what))
        elif not column.released:
            kind = "content" if column.content else "unreleased"
            problems.append(GateProblem(kind, where, f"column {name} may not be released"))
    return problems + [
        GateProblem("undescribed", where, f"column {name} is missing")
        for name in expected
        if name not in names
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
        allowed = ", ".join(_quoted(value) for value in column.values)
        what = f"contains other values than {', '.join(column.values)}"
        rules.append(("content", f"{name} NOT IN ({allowed})", what))
    if column.pattern:
        invalid = f"NOT regexp_full_match({name}, {_quoted(column.pattern)})"
        rules.append(("content", invalid, f"contains other values than {column.pattern}"))
    return rules


def _quoted(text: str) -> str:
    escaped = text.replace("'", "''")
    return f"'{escaped}'"
