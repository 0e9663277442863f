"""What `kb query` may run, and what Arrow and text can hold of its answer."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import duckdb
import duckdb.sqltypes

from kb.artifacts.catalog import SCHEMAS, View
from kb.core.errors import UsageError

# A table by a text that is put together, or by its file's name.
_ANY = re.compile(r"\b(query|query_table|\w*parquet\w*|read_\w+|glob)\b|/|u&")
_COMMENTS = re.compile(r"\A(?:\s*--[^\n]*(?:\n|\Z))+")
_READS = {"select", "from", "with", "values", "(", "pivot", "pivot_wider", "describe", "summarize"}
# DuckDB's names of types that Arrow or Parquet lacks, or holds as bytes of DuckDB's own.
_NO_ARROW = {
    "interval",
    "bit",
    "uhugeint",
    "bignum",
    "time with time zone",
    "union",
    "variant",
    "geometry",
    "tuple",
}
# Functions in FROM that read nothing but the views, the catalog and their own arguments. All others
# read files, memory by its address, settings or logs, or run a text as a query.
_SOURCES = {
    "duckdb_columns", "duckdb_constraints", "duckdb_functions", "duckdb_indexes",
    "duckdb_keywords", "duckdb_schemas", "duckdb_tables", "duckdb_types", "duckdb_views",
    "generate_series", "histogram", "histogram_values", "icu_calendar_names", "json_each",
    "json_tree", "pg_timezone_names", "pragma_show", "pragma_table_info", "pragma_version",
    "range", "repeat", "repeat_row", "summary", "test_all_types", "unnest",
}  # fmt: skip
_SHOWS = {"show", "describe", "desc"}
_BARRED = {"current_setting", "getenv", "getvariable", "write_log"}  # functions of one value
_SETTINGS = {"pg_settings", "duckdb_logs", "duckdb_prepared_statements", "pg_prepared_statements"}

# By DuckDB's version: the same for every connection, whichever thread asks first.
_own: dict[str, tuple[frozenset[str], frozenset[str]]] = {}


def asked(sql: str, views: Sequence[View]) -> list[View]:
    """The views that a query may read: all where it may name one other than by its name."""
    text = sql.lower()
    if _ANY.search(text):
        return list(views)
    return [view for view in views if _names(text, view)]


def _names(sql: str, view: View) -> bool:
    """Whether a query names a view, or a table of its name in no schema."""
    pattern = rf'(?:\b(\w+)"?\s*\.\s*"?)?\b{re.escape(view.name.lower())}\b'
    schemas = {match[1] for match in re.finditer(pattern, sql)}
    return view.schema in schemas or bool(schemas - set(SCHEMAS))


def without_comments(sql: str) -> str:
    """The query without the `--` lines before it, which an option parser takes for options."""
    return _COMMENTS.sub("", sql)


def check(con: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise UsageError for anything but one query, and what DuckDB raises if it can't parse it."""
    kinds = duckdb.StatementType
    statements = con.extract_statements(sql)
    if not statements:
        raise UsageError("0 statements: there is no query in it", hint="give one query")
    if len(statements) != 1:
        raise UsageError(
            f"{len(statements)} statements; kb query runs one", hint="give each its own command"
        )
    kind = statements[0].type
    _refuse(con, sql)
    words = _words(sql)
    at, first = next(words, (0, ""))
    # DuckDB splits what holds a PIVOT without its list of values; COPY and CREATE may hold one
    # as well.
    if kind == kinds.SELECT or (kind == kinds.MULTI and first in _READS):
        return
    if (
        kind in (kinds.EXPLAIN, kinds.MULTI) and first == "explain"
    ):  # EXPLAIN ANALYZE runs what it explains
        at, word = next(words, (0, ""))
        if word == "analyze":
            at, word = next(words, (0, ""))
        if word == "(":
            while word not in (")", ""):
                at, word = next(words, (0, ""))
            at, word = next(words, (0, ""))
        if at:
            check(con, sql.encode()[at:].decode())
            return
    name = first.upper() if kind == kinds.MULTI else kind.name
    raise UsageError(
        f"{name} is no query: kb query only reads",
        hint="SELECT, FROM, PIVOT, DESCRIBE and SUMMARIZE work",
    )


def _refuse(con: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise UsageError for the name of a function or view that reads anything but the views."""
    version = duckdb.__version__
    barred, settings = _own.get(version) or _own.setdefault(version, _own_names(con))
    words = [word for _, word in _words(sql)]
    for word, after in zip(words, [*words[1:], ""], strict=True):
        setting = word in _SHOWS and after in settings
        if word in _SETTINGS or setting or (after == "(" and word in barred):
            raise UsageError(
                f"{word} is not for queries here: they read the views and nothing else",
                hint="`kb query --tables` lists the views",
            )


def _own_names(con: duckdb.DuckDBPyConnection) -> tuple[frozenset[str], frozenset[str]]:
    """DuckDB's own functions that read what is no view of ours, and its settings."""
    functions = con.execute(
        "SELECT DISTINCT lower(function_name) FROM duckdb_functions()"
        " WHERE function_type IN ('table', 'table_macro') AND internal"
    ).fetchall()
    settings = con.execute("SELECT name FROM duckdb_settings()").fetchall()
    barred = _BARRED | ({name for (name,) in functions} - _SOURCES)
    return frozenset(barred), frozenset(name for (name,) in settings)


def _words(sql: str) -> Iterator[tuple[int, str]]:
    """(offset in bytes, word in lower case) of each token that is no comment."""
    raw = sql.encode()
    for at, kind in duckdb.tokenize(sql):
        match = re.match(rb'"(?:[^"]|"")*"|\w+|.', raw[at:], re.DOTALL)
        if match and kind != duckdb.token_type.comment:
            word = match[0].decode(errors="replace").lower()
            yield at, word[1:-1].replace('""', '"') if word.startswith('"') else word


def casts(relation: duckdb.DuckDBPyRelation, *, text: bool) -> str | None:
    """What to select of a relation `answer` so that Arrow can hold it; None when it can already.

    `text`: bytes as well are given as text, as for CSV and JSON.
    """
    wanted = {*_NO_ARROW, "blob"} if text else _NO_ARROW
    if not any(_has(kind, wanted) for kind in relation.types):
        return None
    columns = []
    for name, kind in zip(distinct(relation.columns), relation.types, strict=True):
        quoted = _quoted(name)
        columns.append(
            f"CAST({quoted} AS {_held(kind, wanted)}) AS {quoted}" if _has(kind, wanted) else quoted
        )
    return f"SELECT {', '.join(columns)} FROM answer"


def distinct(names: Sequence[str]) -> list[str]:
    """Names of columns without duplicates, told apart as DuckDB does it: a, a_1, a_2."""
    taken: set[str] = set()
    apart = []
    for name in names:
        new, number = name, 0
        while new.lower() in taken:
            number += 1
            new = f"{name}_{number}"
        taken.add(new.lower())
        apart.append(new)
    return apart


def _has(kind: duckdb.sqltypes.DuckDBPyType, wanted: set[str]) -> bool:
    if kind.id in wanted:
        return True
    return kind.id in ("list", "array", "struct", "map") and any(
        _has(child, wanted) for name, child in _children(kind).items() if name != "size"
    )


def _held(kind: duckdb.sqltypes.DuckDBPyType, wanted: set[str]) -> str:
    """The type in SQL with text for what is in `wanted`."""
    if kind.id in wanted:
        return "VARCHAR"
    if not _has(kind, wanted):
        return str(kind)
    children = _children(kind)
    if kind.id in ("list", "array"):
        return f"{_held(children['child'], wanted)}[{children.get('size', '')}]"
    if kind.id == "map":
        return f"MAP({_held(children['key'], wanted)}, {_held(children['value'], wanted)})"
    fields = [f"{_quoted(name)} {_held(child, wanted)}" for name, child in children.items()]
    return f"STRUCT({', '.join(fields)})"


def _children(kind: duckdb.sqltypes.DuckDBPyType) -> dict[str, Any]:
    """Types by name; an array's "size" is a number."""
    return dict(kind.children)


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
