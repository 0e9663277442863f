"""Checks one file of a data root or release."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from kb.store.tables import checksums
from kb.store.tables.reading import broken


def problem(path: Path, advance: Callable[[int], None]) -> str:
    """What is wrong with a file, "" when nothing is. Every byte is read.

    It is compared with its digest where a manifest or SHA256SUMS has one. Otherwise every page of a
    Parquet file is decoded, and JSON is parsed.
    """
    size = path.stat().st_size
    if (entry := checksums.recorded(path)) is not None:
        return "" if checksums.digest(path, advance=advance) == entry.sha256 else checksums.MISMATCH
    advance(size)
    if path.suffix == ".parquet":
        if not size:
            return "is empty"
        damage = broken([path])
        return "" if damage is None else str(damage).removeprefix(f"{path} ")
    if path.suffix == ".json":
        try:
            json.loads(path.read_bytes())
        except (ValueError, RecursionError) as error:
            return f"can't be read: {error}"
    return ""
