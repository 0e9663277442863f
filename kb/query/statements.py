"""Which statements `kb query` allows, which views they read, and casts of their columns."""

import re
from collections.abc import Iterator, Sequence

import duckdb
import duckdb.sqltypes

from kb.artifacts.table_catalog import SCHEMAS, View
from kb.core.errors import UsageError

# Ways to name a table other than by its name.
_ANY = re.compile(r"\b(query|query_table|\w*parquet\w*|read_\w+|glob)\b|/|u&")
# Ways to ask which tables there are.
_CATALOG = re.compile(r"\b(show|desc|describe|information_schema|(duckdb|pg|pragma|sqlite)_\w+)\b")
_READS = {"select", "from", "with", "values", "(", "pivot", "pivot_wider", "describe", "summarize"}
# DuckDB's types that Arrow or Parquet lacks, or holds in a format of DuckDB's own.
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
# Table functions that read only the views, the catalog and their arguments. All others read files,
# memory by address, settings or logs, or run text as a query.
_SOURCES = {
    "duckdb_columns", "duckdb_constraints", "duckdb_functions", "duckdb_indexes",
    "duckdb_keywords", "duckdb_schemas", "duckdb_tables", "duckdb_types", "duckdb_views",
    "generate_series", "histogram", "histogram_values", "icu_calendar_names", "json_each",
    "json_tree", "pg_timezone_names", "pragma_show", "pragma_table_info", "pragma_version",
    "range", "repeat", "repeat_row", "summary", "test_all_types", "unnest",
}  # fmt: skip
_SHOWS = {"show", "describe", "desc"}
_FORBIDDEN = {"current_setting", "getenv", "getvariable", "write_log"}  # scalar functions
_SETTINGS = {"pg_settings", "duckdb_logs", "duckdb_prepared_statements", "pg_prepared_statements"}

# By DuckDB's version, the same for every connection.
_internal: dict[str, tuple[frozenset[str], frozenset[str]]] = {}


def views_read(sql: str, views: Sequence[View]) -> list[View]:
    """The views that a query may read; all of them if it may name one indirectly."""
    text = sql.lower()
    if _ANY.search(text):
        return list(views)
    read = []
    for view in views:
        pattern = rf'(?:\b(\w+)"?\s*\.\s*"?)?\b{re.escape(view.name.lower())}\b'
        schemas = {match[1] for match in re.finditer(pattern, text)}
        if view.schema in schemas or schemas - set(SCHEMAS):  # by its full or its bare name
            read.append(view)
    return read


def views_needed(sql: str, views: Sequence[View]) -> list[View]:
    """The views without which a query can't run: those that it may read; all of them if it may ask
    which there are.
    """
    return list(views) if _CATALOG.search(sql.lower()) else views_read(sql, views)


def require_query(con: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise UsageError for anything but one query. DuckDB's syntax errors pass through."""
    kinds = duckdb.StatementType
    statements = con.extract_statements(sql)
    if not statements:
        raise UsageError("the query is empty", hint="give one query")
    if len(statements) != 1:
        raise UsageError(
            f"{len(statements)} statements; only one is allowed", hint="run one at a time"
        )
    try:
        kind = statements[0].type
    except ValueError:  # a kind that DuckDB's Python has no name for, such as UPDATE EXTENSIONS
        kind = None
    _refuse(con, sql)
    words = _words(sql)
    at, first = next(words, (0, ""))
    # DuckDB splits a PIVOT without a list of values in several statements; COPY and CREATE may
    # hold one as well.
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
            require_query(con, sql.encode()[at:].decode())
            return
    name = first.upper() if kind in (None, kinds.MULTI) else kind.name
    raise UsageError(
        f"{name} is not allowed: queries only read",
        hint="use SELECT, FROM, PIVOT, DESCRIBE or SUMMARIZE",
    )


def _refuse(con: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise UsageError for functions and views that read anything but our views."""
    version = duckdb.__version__
    words = [word for _, word in _words(sql)]
    forbidden = settings = frozenset[str]()
    if "(" in words or not _SHOWS.isdisjoint(words):
        forbidden, settings = _internal.get(version) or _internal.setdefault(
            version, _internal_names(con)
        )
    for word, after in zip(words, [*words[1:], ""], strict=True):
        setting = word in _SHOWS and after in settings
        if word in _SETTINGS or setting or (after == "(" and word in forbidden):
            raise UsageError(
                f"{word} is not allowed: queries read only the views",
                hint="`kb query --tables` lists the views",
            )


def _internal_names(con: duckdb.DuckDBPyConnection) -> tuple[frozenset[str], frozenset[str]]:
    """DuckDB's functions that read more than the views, and the names of its settings."""
    functions = con.execute(
        "SELECT DISTINCT lower(function_name) FROM duckdb_functions()"
        " WHERE function_type IN ('table', 'table_macro') AND internal"
    ).fetchall()
    settings = con.execute("SELECT name FROM duckdb_settings()").fetchall()
    forbidden = _FORBIDDEN | ({name for (name,) in functions} - _SOURCES)
    return frozenset(forbidden), frozenset(name for (name,) in settings)


def _words(sql: str) -> Iterator[tuple[int, str]]:
    """(offset in bytes, word in lower case) of each token except comments."""
    raw = sql.encode()
    for at, kind in duckdb.tokenize(sql):
        match = re.match(rb'"(?:[^"]|"")*"|\w+|.', raw[at:], re.DOTALL)
        if match and kind != duckdb.token_type.comment:
            word = match[0].decode(errors="replace").lower()
            yield at, word[1:-1].replace('""', '"') if word.startswith('"') else word


def casts(relation: duckdb.DuckDBPyRelation, *, text: bool) -> str | None:
    """A SELECT over a relation `answer` with columns as text that Arrow can't hold; None without
    such columns.

    With `text`, columns of bytes become text as well, as CSV and JSON need.
    """
    unsupported = {*_NO_ARROW, "blob"} if text else _NO_ARROW
    names = ['"' + name.replace('"', '""') + '"' for name in distinct(relation.columns)]
    columns = [
        f"{name}::VARCHAR AS {name}" if _has(kind, unsupported) else name
        for name, kind in zip(names, relation.types, strict=True)
    ]
    return f"SELECT {', '.join(columns)} FROM answer" if columns != names else None


def _has(kind: duckdb.sqltypes.DuckDBPyType, unsupported: set[str]) -> bool:
    """Whether a type or one nested in it is unsupported."""
    if kind.id in unsupported:
        return True
    if kind.id not in ("list", "array", "struct", "map"):
        return False
    children = (child for _, child in kind.children)  # an array's size is a number among them
    return any(
        isinstance(child, duckdb.sqltypes.DuckDBPyType) and _has(child, unsupported)
        for child in children
    )


def distinct(names: Sequence[str]) -> list[str]:
    """Column names without duplicates, numbered as DuckDB does it: a, a_1, a_2."""
    taken: set[str] = set()
    unique = []
    for name in names:
        new, number = name, 0
        while new.lower() in taken:
            number += 1
            new = f"{name}_{number}"
        taken.add(new.lower())
        unique.append(new)
    return unique
