"""What a released Parquet file or sample may hold: declared columns of declared types,
and values as `schemas/` says.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import orjson
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.core.errors import DamagedData
from kb.core.sources import RELEASES
from kb.release.gate.problem import GateProblem, damaged
from kb.schema import Table
from kb.schema.tables import Column
from kb.store import parquet

_LONGEST_ID = 16  # ids, types and full names; anything longer is content


def check(path: Path, declared: Table, source: str) -> list[GateProblem]:
    """Every problem of one file: to be readable, described, without nulls where there are none,
    and no content.
    """
    where = f"{source}/{path.name}"
    try:
        parquet.check(path)
        schema = pq.read_schema(path)
        problems = _columns(declared, schema, where)
        return problems or _values(
            path, declared, where, ids_only=RELEASES[source].ids_only and declared.source == source
        )
    except (pa.ArrowException, OSError, DamagedData) as error:
        return [damaged(where, error, "export it again")]


def check_rows(path: Path, declared: Table, source: str) -> list[GateProblem]:
    """The same of rows in JSON: a sample, which is a list of them, or tombstones, one a line."""
    where = f"{source}/{path.name}"
    try:
        data = path.read_bytes()
        lines = path.suffix == ".ndjson"
        rows = [*map(orjson.loads, data.splitlines())] if lines else orjson.loads(data)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise ValueError("it is no list of rows")
    except (ValueError, OSError) as error:
        return [damaged(where, error, "run `kb release` again")]
    expected = declared.arrow(True)
    known = {column.name: column for column in declared.columns}
    if rows and (strange := sorted({name for row in rows for name in row} ^ set(expected.names))):
        return [
            _strange(name, known.get(name), where, missing=name in expected.names)
            for name in strange
        ]
    problems = []
    for field in expected:
        column = known[field.name]
        try:
            values = _array([row.get(field.name) for row in rows], field.type)
        except (pa.ArrowException, ValueError, TypeError):
            what = f"column {field.name} contains other values than {column.type}"
            problems.append(GateProblem("undescribed", where, what))
            continue
        ids_only = RELEASES[source].ids_only and declared.source == source
        if problem := _odd(values, column, where, ids_only=ids_only):
            problems.append(problem)
    return problems


def _array(values: list[Any], kind: pa.DataType) -> pa.Array[Any]:
    """JSON's values in a column's type; times are texts there."""
    if pa.types.is_timestamp(kind):
        times = [None if one is None else datetime.fromisoformat(one) for one in values]
        values = times
    made: pa.Array[Any] = pa.array(values, kind)
    return made


def _strange(name: str, column: Column | None, where: str, *, missing: bool) -> GateProblem:
    if missing:
        return GateProblem("undescribed", where, f"column {name} is missing")
    if column is None:
        return GateProblem("undescribed", where, f"column {name} is not described in schemas/")
    word = "content" if column.content else "unreleased"
    return GateProblem(word, where, f"column {name} may not be released")


def _columns(declared: Table, schema: pa.Schema, where: str) -> list[GateProblem]:
    known = {column.name: column for column in declared.columns}
    expected = declared.arrow(True)
    problems = []
    for field in schema:
        column = known.get(field.name)
        if column is None or not column.released:
            problems.append(_strange(field.name, column, where, missing=False))
        elif field.type != expected.field(field.name).type:
            problems.append(
                GateProblem(
                    "undescribed",
                    where,
                    f"column {field.name} is {field.type}, schemas/ says {column.type}",
                )
            )
    problems += [
        _strange(name, known[name], where, missing=True)
        for name in expected.names
        if name not in schema.names
    ]
    return problems


def _values(path: Path, declared: Table, where: str, *, ids_only: bool) -> list[GateProblem]:
    """The first odd value of each column, read a batch at a time; what it says is not shown,
    as it may be content.
    """
    problems = []
    file = parquet.open_file(path)
    for column in declared.columns:
        if not column.released:
            continue
        for batch in file.iter_batches(columns=[column.name]):
            if problem := _odd(batch.column(0), column, where, ids_only=ids_only):
                problems.append(problem)
                break
    return problems


def _odd(
    values: pa.Array[Any], column: Column, where: str, *, ids_only: bool
) -> GateProblem | None:
    if values.null_count and not column.nullable:
        return GateProblem(
            "null",
            where,
            f"column {column.name} has rows without a value,"
            " schemas/ says there are none; export it again",
        )
    if column.type != "string":
        return None
    values = values.drop_null()
    if ids_only:
        # No text of a released Reddit table may be longer than an id or hold an address, whatever
        # its column says.
        odd = pc.or_(
            pc.greater(pc.utf8_length(values), _LONGEST_ID),
            pc.match_substring_regex(values, r"[\s/@]"),
        )
        if pc.any(odd).as_py():
            return GateProblem("content", where, f"column {column.name} holds text that is no id")
    if column.values and not pc.all(pc.is_in(values, pa.array(column.values)), min_count=0).as_py():
        return GateProblem(
            "content",
            where,
            f"column {column.name} contains other values than {', '.join(column.values)}",
        )
    if (
        column.pattern
        and not pc.all(
            pc.match_substring_regex(values, rf"\A(?:{column.pattern})\z"), min_count=0
        ).as_py()
    ):
        return GateProblem(
            "content", where, f"column {column.name} contains other values than {column.pattern}"
        )
    return None


def numbered(names: list[str], stem: str, ending: str) -> bool:
    """Whether `names` are all files of one export: 0 to n-1 of n."""
    total = len(names)
    return names == [f"{stem}-{index:05d}-of-{total:05d}.{ending}" for index in range(total)]
