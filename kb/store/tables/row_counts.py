"""Counts kept, rejected, failed and pending rows in clean/<source> for all summaries."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path

from kb.store.damage import opening
from kb.store.layout import VERDICTS, parquet_files
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan


def rows(folder: Path) -> int:
    """Rows of a table, from its files' footers. Raises DamagedData."""
    files = parquet_files(folder)
    with reading(files):
        return sum(parquet.footer(file).num_rows for file in files)


def tally(clean: Path, tables: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """By table: crawled, kept, rejected, failed, pending, and `missing` of the rejected ones.

    `clean` is the folder of a source, `tables` as in Source.tables. Tables that are not
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
    counts = (f"count(*) FILTER (starts_with(key, '{prefix}'))" for prefix in tables.values())
    sql = f"SELECT {', '.join(counts)} FROM {scan(files)}"
    with reading(files), database.over(files) as con:
        parquet.verify_files(*files)
        row = con.execute(f"{sql} WHERE stage = '{stage}'" if stage else sql).fetchone()
    return dict(zip(tables, row or (), strict=True))


def span(
    files: Iterable[Path],
    column: str,
    limit: datetime,
    of: Sequence[tuple[str, str]] = (),
) -> tuple[datetime | None, datetime | None, int]:
    """The first and last time of a column, and how many are before `limit`: of all rows, or
    of those with one of the values `of` columns.

    Nothing for files without that column. Raises DamagedData.
    """
    having = [path for path in files if column in parquet.names(path)]
    if not having:
        return None, None, 0
    names = {name for path in having for name in parquet.names(path)}
    counted = " OR ".join(f"{name} = '{value}'" for name, value in of if name in names) or "true"
    with reading(having), database.over(having) as con:
        sql = (
            f"min({column}) AS first, max({column}) AS last,"
            f" count(*) FILTER ({column} < ? AND ({counted})) AS n"
        )
        rows = con.sql(f"SELECT {sql} FROM {scan(having)}", params=[limit]).to_arrow_table()
    with opening(having[0], OverflowError):  # a time of no year from 1 to 9999
        row = rows.to_pylist()[0]
    return row["first"], row["last"], row["n"]
