"""<table>.sample.json: some rows of each table that belong together, for a first look.

A JSON list with a row a line, times in ISO 8601. No Parquet: whoever reads `*.parquet` of a folder
would have these rows twice.

The tables of a folder share a column (a page, a post, a video). Its values are taken in the order
of their MD5, so the sample is spread over the data and the same each time, until it is large
enough.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import orjson
import pyarrow as pa
from duckdb import DuckDBPyConnection

from kb.artifacts.release_folder import ReleasedTable, ReleaseFolder
from kb.release.folders import sample_name
from kb.store.atomic import writing
from kb.store.tables import database
from kb.store.tables.shard_writer import order

_MOST = 5_000  # groups: a sample is for reading


def write(folder: ReleaseFolder, megabytes: float) -> list[Path]:
    """Write one sample file a table, together at most `megabytes`.

    Bytes follow from the data alone.
    """
    shared = _shared(folder.parts)
    data = sum(shard.stat().st_size for part in folder.parts for shard in part.shards)
    with database.asking() as con:
        lead = next((part for part in folder.parts if part.table.key == (shared,)), folder.parts[0])
        con.execute(
            f'CREATE TEMP TABLE chosen AS SELECT DISTINCT "{shared}" AS k,'
            f' md5("{shared}"::VARCHAR) AS h FROM read_parquet(?) ORDER BY h',
            [[str(shard) for shard in lead.shards]],
        )
        total = con.execute("SELECT count(*) FROM chosen").fetchall()[0][0]
        budget = megabytes * 1e6
        take = min(_MOST, max(1, int(total * min(1.0, 0.8 * budget / max(1, data)))))
        while True:
            written = [_part(con, folder, part, shared, take) for part in folder.parts]
            size = sum(path.stat().st_size for path in written)
            if size <= budget or take == 1:
                return written
            # Few rows compress worse than many: what was too much tells how much is right.
            take = max(1, min(take - 1, int(take * 0.9 * budget / size)))


def _part(
    con: DuckDBPyConnection, folder: ReleaseFolder, part: ReleasedTable, shared: str, take: int
) -> Path:
    rows = con.sql(
        f'SELECT t.* FROM read_parquet(?) t WHERE t."{shared}" IN (SELECT k FROM chosen'
        f" ORDER BY h LIMIT {take})",
        params=[[str(shard) for shard in part.shards]],
    ).to_arrow_table()
    rows = rows.sort_by([(name, "ascending") for name in order(part.table)])
    path = folder.path / sample_name(part.table)
    columns = [_values(rows[name]) for name in rows.column_names]
    with writing(path) as temporary, temporary.open("wb") as file:
        file.write(b"[")
        for number, row in enumerate(zip(*columns, strict=True)):
            file.write(b",\n" if number else b"\n")
            line = dict(zip(rows.column_names, row, strict=True))
            file.write(orjson.dumps(line, option=orjson.OPT_UTC_Z))
        file.write(b"\n]\n")
    return path


def _values(column: pa.ChunkedArray[Any]) -> list[Any]:
    """Python's values; of a 32-bit number its own digits: 0.12, not 0.11999999731779099."""
    if not pa.types.is_float32(column.type):
        return column.to_pylist()
    return [None if text is None else float(text) for text in column.cast(pa.string()).to_pylist()]


def _shared(parts: tuple[ReleasedTable, ...]) -> str:
    """The column that all tables of the folder have and that is a key of one;
    else the first's first key.
    """
    for name in ("page_id", "post_id", "video_id"):
        if all(name in part.table.names(released=True) for part in parts):
            return name
    return parts[0].table.key[0]
