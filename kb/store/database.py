"""The one place that opens DuckDB.

A connection is in memory, prints times in UTC whatever the machine's zone, never loads or fetches
an extension by itself, and spills to the data root's `.duckdb` (DuckDB sweeps what a killed
process left there), not to the folder where the command was typed.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import duckdb

SPILL = ".duckdb"  # below the data root; there only while something is spilled


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
        return root.absolute() / SPILL
    return Path(tempfile.gettempdir()) / f"lorebase-duckdb-{os.getuid()}"
