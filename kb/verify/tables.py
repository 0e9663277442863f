"""Parquet files, one by one: whole, or what is wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from kb.store import parquet
from kb.store.reading import broken


def problem(path: Path, advance: Callable[[int], None]) -> str:
    """What is wrong with a Parquet file, "" when nothing is. Every byte is read.

    A file of others has no checksum: its pages are decoded instead, a batch at a time.
    """
    if not path.stat().st_size:
        return "is empty"
    if parquet.has_checksum(path):
        if not parquet.holds(path, advance):
            return "its bytes are not those that were written"
        try:
            pq.read_metadata(path)
        except (pa.ArrowException, OSError) as error:
            return f"can't be read: {(str(error).splitlines() or [type(error).__name__])[0]}"
        return ""
    damage = broken([path])
    advance(path.stat().st_size)
    return "" if damage is None else str(damage).removeprefix(f"{path} ")
