"""The four answers of a source, counted in the files of clean/<source>: what all summaries say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pyarrow.parquet as pq

from kb.store.database import connect
from kb.store.layout import parquet_files
from kb.store.reading import reading, scan

VERDICTS = ("rejected", "failed", "pending")


def rows(folder: Path) -> int:
    """Rows of a table, from its files' footers. Raises DamagedData."""
    found = parquet_files(folder)
    with reading(found):
        return sum(pq.read_metadata(file).num_rows for file in found)


def tally(clean: Path, tables: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """By table: crawled, kept, rejected, failed, pending, and `missing` of the rejected ones.

    `clean` is the folder of a source, `tables` as in kb.core.sources.SORTED. Tables that are not
    there are left out. Raises DamagedData.
    """
    found = {}
    verdicts = {verdict: _keys(clean / verdict, tables) for verdict in VERDICTS}
    missing = _keys(clean / "rejected", tables, "stage = 'missing'")
    for name in tables:
        answers = {verdict: counts.get(name, 0) for verdict, counts in verdicts.items()}
        if not parquet_files(clean / name) and not any(answers.values()):
            continue
        kept = rows(clean / name)
        crawled = kept + sum(answers.values())
        found[name] = {
            "crawled": crawled,
            "kept": kept,
            **answers,
            "missing": missing.get(name, 0),
        }
    return found


def _keys(folder: Path, tables: Mapping[str, str], where: str = "true") -> dict[str, int]:
    """How many keys of a verdict's files belong to which table."""
    found = parquet_files(folder)
    if not found:
        return {}
    sums = ", ".join("count(*) FILTER (starts_with(key, ?))" for _ in tables)
    sql = f"SELECT {sums} FROM {scan(found)} WHERE {where}"
    with reading(found), connect() as con:
        counts = con.execute(sql, list(tables.values())).fetchone() or ()
    return dict(zip(tables, counts, strict=False))
