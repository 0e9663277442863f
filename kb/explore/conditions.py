"""Conditions on columns: from the fields of a form to SQL, which `--where` takes as well."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from kb.core.errors import UsageError
from kb.explore.tables import quoted
from kb.store.tables.reading import text_literal

MOST = 6  # conditions of an address
_EQUAL = {"is": "=", "is not": "<>"}
_SIGNS = _EQUAL | {"at least": ">=", "at most": "<=", "above": ">", "below": "<"}
TESTS = (*_SIGNS, "contains", "is empty", "is there")
_NUMBERS = ("INT", "DOUBLE", "FLOAT", "DECIMAL", "HUGEINT")


class Condition(NamedTuple):
    """What a column of a row must be, as the fields columnN, testN and valueN say."""

    column: str
    test: str
    value: str


def conditions(query: Mapping[str, str]) -> list[Condition]:
    """The conditions of an address. Raises UsageError for an unknown test."""
    given = [
        Condition(column, query.get(f"test{n}", TESTS[0]), query.get(f"value{n}", "").strip())
        for n in range(1, MOST + 1)
        if (column := query.get(f"column{n}", ""))
    ]
    for condition in given:
        if condition.test not in TESTS:
            raise UsageError(f"unknown test {condition.test!r}")
    return given


def fields(given: list[Condition]) -> dict[str, str]:
    """The fields of an address that has these conditions."""
    return {
        f"{name}{n}": value
        for n, condition in enumerate(given, start=1)
        for name, value in condition._asdict().items()
        if value
    }


def sql_of(given: list[Condition], kinds: Mapping[str, str]) -> list[str]:
    """Each condition as SQL; `kinds` are DuckDB's types of the columns. Raises UsageError for a
    column that is not there, and for a value that the column can't have.
    """
    return [_sql(condition, kinds) for condition in given]


def _sql(condition: Condition, kinds: Mapping[str, str]) -> str:
    column, test, value = condition
    if column not in kinds:
        raise UsageError(f"unknown column {column!r}")
    name = column if re.fullmatch(r"[a-z_][a-z0-9_]*", column) else quoted(column)
    if test in ("is empty", "is there"):
        return f"{name} IS {'NOT ' if test == 'is there' else ''}NULL"
    if test == "contains":
        return f"contains(lower({name}::VARCHAR), {text_literal(value.lower())})"
    kind = kinds[column]
    if kind == "BOOLEAN":
        if value.lower() not in ("yes", "no", "true", "false"):
            raise UsageError(f"{column} is yes or no, not {value!r}")
        value = str(value.lower() in ("yes", "true")).lower()
    elif any(part in kind for part in _NUMBERS) and "[" not in kind:
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise UsageError(f"{column} is a number, not {value!r}")
    else:
        name = name if kind == "VARCHAR" else f"{name}::VARCHAR"
        value = text_literal(value)
    return f"{name} {_SIGNS[test]} {value}"
