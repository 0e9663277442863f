"""Errors for unknown tables and columns, with the nearest names or the command that makes them."""

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

import duckdb

from kb.artifacts.table_catalog import SCHEMAS, empty, view_name
from kb.core.errors import KbError, UsageError
from kb.core.sources import PUBLISHED, SOURCES, exported_by
from kb.schema.tables import tables

_TABLE = re.compile(r'Table with name "?([^"!]+?)"? does not exist')
_COLUMN = re.compile(r'Values list "[^"]*" does not have a column named "([^"]+)"')
_LISTS = "`kb query --tables` lists the views"


def unknown(
    con: duckdb.DuckDBPyConnection, sql: str, error: Exception, root: Path | None
) -> KbError | None:
    """The error for an unknown table or column; None for an error of another kind."""
    text = str(error)
    if missing := _TABLE.search(text):
        return _table(con, _qualified(missing[1], sql), text.splitlines()[0], root)
    if missing := _COLUMN.search(text):
        near = similar(missing[1], _columns(con, sql))
        return UsageError(f"{one_line(error)}.{_did_you_mean(near)}", hint=_LISTS)
    return None


def similar(name: str, names: Iterable[str]) -> list[str]:
    """The most similar names, at most three; none much less similar than the first."""
    by_lower = {one.lower(): one for one in names}
    near = difflib.get_close_matches(name.lower(), by_lower, 3)
    ratios = [difflib.SequenceMatcher(None, one, name.lower()).ratio() for one in near]
    return [
        by_lower[one] for one, ratio in zip(near, ratios, strict=True) if ratio > ratios[0] - 0.1
    ]


def one_line(error: Exception) -> str:
    """DuckDB's message without the excerpt of the query, and with three suggestions at most."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if not lines:
        return type(error).__name__
    starts = ("Did you mean", "Candidate bindings", "Candidate functions", "Candidate Entries")
    guesses = [line for line in lines[1:] if line.startswith(starts) and "duckdb_" not in line]
    return " ".join([lines[0], *(", ".join(line.split(", ")[:3]) for line in guesses)])


def _table(con: duckdb.DuckDBPyConnection, name: str, message: str, root: Path | None) -> KbError:
    views = list(_views(con))
    schema, _, short = name.rpartition(".")
    full = [f"{one}.{view}" for one, view in views]
    if schema:
        near = [one for one in full if one.endswith(f".{short}")] or similar(name, full)
    else:
        near = similar(name, {view for _, view in views})
    message = message.partition(" because ")[0].rstrip("!")
    if not views:
        return empty((root or Path("data")).absolute())
    return UsageError(
        f"{message}!{_did_you_mean(near)}", hint=(not near and _made_by(short, schema)) or _LISTS
    )


def _qualified(name: str, sql: str) -> str:
    """The name with the schema given in the query, which DuckDB's message leaves out."""
    given = re.search(rf'"?\b(\w+)"?\s*\.\s*"?{re.escape(name)}\b', sql, re.IGNORECASE)
    return f"{given[1].lower()}.{name}" if given and given[1].lower() in SCHEMAS else name


def _made_by(short: str, schema: str) -> str:
    """The commands that make a declared table without files."""
    if schema == "restored":
        return "`kb reddit reconstruct` makes it"
    known = {view_name(one): one.source for one in tables().values() if one.source in PUBLISHED}
    if short not in known:
        return ""
    source = known[short]
    if source not in SOURCES or schema == "release":
        return f"`{exported_by(source)}` makes it"
    return f"`kb {source} crawl`, then `kb {source} filter` make it"


def _did_you_mean(near: list[str]) -> str:
    return f" Did you mean {' or '.join(near)}?" if near else ""


def _views(con: duckdb.DuckDBPyConnection) -> list[tuple[str, str]]:
    sql = "SELECT schema_name, view_name FROM duckdb_views() WHERE list_contains(?, schema_name)"
    return [(schema, view) for schema, view in con.execute(sql, [list(SCHEMAS)]).fetchall()]


def _columns(con: duckdb.DuckDBPyConnection, sql: str) -> list[str]:
    """Columns of the views named in the query."""
    words = set(re.findall(r"\w+", sql))
    rows = con.execute(
        "SELECT DISTINCT column_name FROM duckdb_columns() WHERE list_contains(?, table_name)",
        [sorted(words)],
    )
    return [name for (name,) in rows.fetchall()]
