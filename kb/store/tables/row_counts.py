"""Counts kept, rejected, failed and pending rows in clean/<source> for all summaries."""

from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq

from kb.store.layout import parquet_files
from kb.store.tables import parquet
from kb.store.tables.reading import reading

VERDICTS = ("rejected", "failed", "pending")


def rows(folder: Path) -> int:
    """Rows of a table, from its files' footers. Raises DamagedData."""
    files = parquet_files(folder)
    with reading(files):
        return sum(pq.read_metadata(file).num_rows for file in files)


def tally(clean: Path, tables: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """By table: crawled, kept, rejected, failed, pending, and `missing` of the rejected ones.

    `clean` is the folder of a source, `tables` as in SourceSpec.tables. Tables that are not
    there are left out. Raises DamagedData.
    """
    by_table = {}
    verdicts = {verdict: _keys(clean / verdict, tables) for verdict in VERDICTS}
    missing = _keys(clean / "rejected", tables, "missing")
    for name in tables:
        answers = {verdict: counts.get(name, 0) for verdict, counts in verdicts.items()}
        if not parquet_files(clean / name) and not any(answers.values()):
            continue
        kept = rows(clean / name)
        crawled = kept + sum(answers.values())
        by_table[name] = {
            "crawled": crawled,
            "kept": kept,
            **answers,
            "missing": missing.get(name, 0),
        }
    return by_table


def _keys(folder: Path, tables: Mapping[str, str], stage: str = "") -> dict[str, int]:
    """How many keys of a verdict's files belong to which table; of one stage only, or of all."""
    files = parquet_files(folder)
    if not files:
        return {}
    counts = dict.fromkeys(tables, 0)
    with reading(files):
        for path in files:
            with parquet.open_file(path) as file:
                for batch in file.iter_batches(columns=["key", "stage"] if stage else ["key"]):
                    keys = batch["key"]
                    if stage:
                        keys = keys.filter(pc.equal(batch["stage"], stage))
                    for name, prefix in tables.items():
                        counts[name] += pc.sum(pc.starts_with(keys, prefix)).as_py() or 0
    return counts


def span(
    files: Iterable[Path], column: str, limit: datetime
) -> tuple[datetime | None, datetime | None, int]:
    """The first and last time of a column, and how many are before `limit`.

    From the files' footers; rows are read only where the limit falls into a row group. Nothing for
    files without that column. Raises DamagedData.
    """
    times: list[datetime] = []
    before = 0
    for path in files:
        footer = pq.read_metadata(path)
        names = footer.schema.to_arrow_schema().names
        for group in range(footer.num_row_groups if column in names else 0):
            statistics = _statistics(footer.row_group(group), column)
            if statistics is not None and statistics.has_min_max:
                low, high, count = statistics.min, statistics.max, statistics.num_values
                before += count if high < limit else 0
                times += (low, high)
                if not low < limit <= high:
                    continue
            with parquet.open_file(path) as file:
                read = file.read_row_group(group, [column])[column].to_pylist()
            known = [time for time in read if time is not None]
            times += known
            before += sum(time < limit for time in known)
    return min(times, default=None), max(times, default=None), before


def _statistics(group: Any, column: str) -> Any:
    """What a row group's footer says of a column, None where it says nothing."""
    for number in range(group.num_columns):
        chunk = group.column(number)
        if chunk.path_in_schema == column:
            return chunk.statistics
    return None
