"""The one place that opens DuckDB.

A connection is in memory, prints times in UTC whatever the machine's zone, never loads or fetches
an extension by itself, and spills to a folder of this process below the data root, not to where the
command was typed. DuckDB removes it at the end; what a killed process left there holds rows that
may have been purged since, so kb.store.leftovers clears it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from kb.core.installation import duckdb
from kb.store import atomic
from kb.store.leftovers import SPILL

FEW = 16 << 20  # bytes of Parquet of which nothing is spilled


def connect(
    root: Path | None = None, *, threads: int | None = None, memory: str | None = None
) -> duckdb.DuckDBPyConnection:
    """A new in-memory DuckDB; `memory` as DuckDB writes it ("1GB"), otherwise its own choice.

    Without a `root`, or where that is not there or can't be written to, it spills to the system's
    temporary folder.
    """
    spill = Path(tempfile.gettempdir()) / f"lorecrawl-duckdb-{os.getuid()}"
    if root is not None and root.is_dir() and os.access(root, os.W_OK):
        spill = root.absolute() / f"{SPILL}-{atomic.mark()}"
    config: dict[str, str | bool | int | float | list[str]] = {
        "autoinstall_known_extensions": False,
        "autoload_known_extensions": False,
        "temp_directory": str(spill),
    }
    if threads is not None:
        config["threads"] = threads
    if memory is not None:
        config["memory_limit"] = memory
    con = duckdb.connect(config=config)
    _set(con)
    return con


def asking() -> duckdb.DuckDBPyConnection:
    """A connection to the one DuckDB of this process, for a question that leaves no table or view
    behind: opening one of its own costs more than most questions.
    """
    con = _own(os.getpid()).cursor()
    _set(con)
    return con


def over(
    files: Iterable[Path], root: Path | None = None, *, memory: str | None = None
) -> duckdb.DuckDBPyConnection:
    """A connection for questions about these files that leave no table or view behind: as `asking`
    where they are small, else as `connect`.
    """
    if sum(path.stat().st_size for path in files) <= FEW:
        return asking()
    return connect(root, memory=memory)


@functools.cache
def _own(pid: int) -> duckdb.DuckDBPyConnection:
    """Of the process `pid`: a forked one has none of the threads of its parent's."""
    return connect()


# DuckDB complains on stderr about a connection that lives until the interpreter ends.
atexit.register(_own.cache_clear)


def _set(con: duckdb.DuckDBPyConnection) -> None:
    con.execute("SET TimeZone = 'UTC'")
    # In a notebook without ipywidgets DuckDB shows no progress, and refuses to be told so.
    with contextlib.suppress(duckdb.InvalidInputException):
        con.execute("SET enable_progress_bar = false")


def one_line(error: Exception) -> str:
    """DuckDB's message without the excerpt of the query, and with three suggestions at most."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if not lines:
        return type(error).__name__
    starts = ("Did you mean", "Candidate bindings", "Candidate functions", "Candidate Entries")
    guesses = [line for line in lines[1:] if line.startswith(starts) and "duckdb_" not in line]
    return " ".join([lines[0], *(", ".join(line.split(", ")[:3]) for line in guesses)])
