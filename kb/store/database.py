"""The one place that opens DuckDB.

A connection is in memory, prints times in UTC whatever the machine's zone, never loads or fetches
an extension by itself, and spills to a folder of this process below the data root, not to where the
command was typed. DuckDB removes it at the end; what a killed process left there holds rows that
may have been purged since, so kb.store.leftovers asks `abandoned` and clears it.
"""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

import duckdb

SPILL = ".duckdb"  # and the process; below the data root, there only while something is spilled
_SPILL = re.compile(r"\.duckdb-(\d+)-(\d+)")


def connect(
    root: Path | None = None, *, threads: int | None = None, memory: str | None = None
) -> duckdb.DuckDBPyConnection:
    """A new in-memory DuckDB; `memory` as DuckDB writes it ("1GB"), otherwise its own choice.

    Without a `root`, or where that is not there or can't be written to, it spills to the system's
    temporary folder.
    """
    config: dict[str, str | bool | int | float | list[str]] = {
        "autoinstall_known_extensions": False,
        "autoload_known_extensions": False,
        "temp_directory": str(_spill(root)),
    }
    if threads is not None:
        config["threads"] = threads
    if memory is not None:
        config["memory_limit"] = memory
    con = duckdb.connect(config=config)
    con.execute("SET TimeZone = 'UTC'")
    con.execute("SET enable_progress_bar = false")
    return con


def _spill(root: Path | None) -> Path:
    if root is not None and root.is_dir() and os.access(root, os.W_OK):
        return root.absolute() / f"{SPILL}-{os.getpid()}-{_started('self')}"
    return Path(tempfile.gettempdir()) / f"lorebase-duckdb-{os.getuid()}"


def abandoned(folder: Path) -> bool:
    """Whether a folder is what a process spilled that is not there any more."""
    match = _SPILL.fullmatch(folder.name)
    return match is not None and _started(match[1]) != int(match[2])


def _started(process: str) -> int:
    """When a process of this machine began, in ticks since it was booted; -1: there is none.

    Together with its number that names it for good, where numbers are given again.
    """
    try:
        said = Path("/proc", process, "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return -1
    # The second field is a name in brackets, which may hold anything; this is the 22nd.
    return int(said.rpartition(")")[2].split()[19])
