"""A name that is not there: the nearest ones that are, or what has to be run to have it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

import duckdb

from kb.artifacts.catalog import SCHEMAS, empty, view_name
from kb.core.errors import KbError, UsageError
from kb.core.sources import PUBLISHED, SOURCES, exported_by
from kb.schema.tables import tables

_TABLE = re.compile(r'Table with name "?([^"!]+?)"? does not exist')
_COLUMN = re.compile(r'Values list "[^"]*" does not have a column named "([^"]+)"')
_LISTS = "`kb query --tables` lists the views"


def unknown(
    con: duckdb.DuckDBPyConnection, sql: str, error: Exception, root: Path | None
) -> KbError | None:
    """What to say of a table or column that is not there; None for an error of another kind."""
    text = str(error)
    if missing := _TABLE.search(text):
        return _table(con, _qualified(missing[1], sql), text.splitlines()[0], root)
    if missing := _COLUMN.search(text):
        near = close(missing[1], _columns(con, sql))
        return UsageError(f"{one_line(error)}.{_guess(near)}", hint=_LISTS)
    return None


def close(name: str, there: Iterable[str]) -> list[str]:
    """At most three names that are like it, the nearest first; none that is much less like it."""
    by_lower = {one.lower(): one for one in there}
    near = difflib.get_close_matches(name.lower(), by_lower, 3)
    like = [difflib.SequenceMatcher(None, one, name.lower()).ratio() for one in near]
    return [by_lower[one] for one, ratio in zip(near, like, strict=True) if ratio > like[0] - 0.1]


def one_line(error: Exception) -> str:
    """DuckDB's message without its drawing of the query; of its guesses the nearest three."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if not lines:
        return type(error).__name__
    starts = ("Did you mean", "Candidate bindings", "Candidate functions", "Candidate Entries")
    guesses = [line for line in lines[1:] if line.startswith(starts) and "duckdb_" not in line]
    return " ".join([lines[0], *(", ".join(line.split(", ")[:3]) for line in guesses)])


def _table(con: duckdb.DuckDBPyConnection, name: str, said: str, root: Path | None) -> KbError:
    views = list(_views(con))
    schema, _, short = name.rpartition(".")
    full = [f"{one}.{view}" for one, view in views]
    if schema:
        near = [one for one in full if one.endswith(f".{short}")] or close(name, full)
    else:
        near = close(name, {view for _, view in views})
    said = said.partition(" because ")[0].rstrip("!")
    if not views:
        return empty((root or Path("data")).absolute())
    return UsageError(f"{said}!{_guess(near)}", hint=(not near and _how(short, schema)) or _LISTS)


def _qualified(name: str, sql: str) -> str:
    """The name with the schema that the query gives it; DuckDB's message leaves it out."""
    given = re.search(rf'"?\b(\w+)"?\s*\.\s*"?{re.escape(name)}\b', sql, re.IGNORECASE)
    return f"{given[1].lower()}.{name}" if given and given[1].lower() in SCHEMAS else name


def _how(short: str, schema: str) -> str:
    """The commands that make a declared table which has no files yet."""
    if schema == "restored":
        return "`kb reddit reconstruct` makes it"
    known = {view_name(one): one.source for one in tables().values() if one.source in PUBLISHED}
    if short not in known:
        return ""
    source = known[short]
    if source not in SOURCES or schema == "release":
        return f"`{exported_by(source)}` makes it"
    return f"`kb {source} crawl`, then `kb {source} filter` make it"


def _guess(near: list[str]) -> str:
    return f" Did you mean {' or '.join(near)}?" if near else ""


def _views(con: duckdb.DuckDBPyConnection) -> list[tuple[str, str]]:
    sql = "SELECT schema_name, view_name FROM duckdb_views() WHERE list_contains(?, schema_name)"
    return [(schema, view) for schema, view in con.execute(sql, [list(SCHEMAS)]).fetchall()]


def _columns(con: duckdb.DuckDBPyConnection, sql: str) -> list[str]:
    """Columns of the views that the query names."""
    words = set(re.findall(r"\w+", sql))
    rows = con.execute(
        "SELECT DISTINCT column_name FROM duckdb_columns() WHERE list_contains(?, table_name)",
        [sorted(words)],
    )
    return [name for (name,) in rows.fetchall()]
