"""sample-<table>.parquet: some rows of each table that belong together, for a first look.

The tables of a folder share a column (a page, a post, a video). Its values are taken in the order
of their MD5, so the sample is spread over the data and the same each time, until it is large enough.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kb.release.folders import Folder, Part
from kb.store.shards import write_table

if TYPE_CHECKING:
    from pathlib import Path

_MOST = 5_000  # groups: a sample is for reading


def write(folder: Folder, megabytes: float) -> list[Path]:
    """Write one sample file a table. Bytes follow from the data alone."""
    import duckdb

    shared = _shared(folder.parts)
    budget = megabytes * 1e6 * 0.8  # a sample compresses a little worse than a shard
    weight = {part.table.name: sum(shard.stat().st_size for shard in part.shards) for part in folder.parts}
    share = min(1.0, budget / max(1, sum(weight.values())))
    written = []
    with duckdb.connect() as con:
        con.execute("SET TimeZone = 'UTC'")
        lead = next((part for part in folder.parts if part.table.key == (shared,)), folder.parts[0])
        con.execute(
            f'CREATE TABLE chosen AS SELECT DISTINCT "{shared}" AS k, md5("{shared}"::VARCHAR) AS h FROM read_parquet(?) ORDER BY h',
            [[str(shard) for shard in lead.shards]])
        total = con.execute("SELECT count(*) FROM chosen").fetchall()[0][0]
        take = min(_MOST, max(1, int(total * share)))
        for part in folder.parts:
            found = con.sql(
                f'SELECT t.* FROM read_parquet(?) t WHERE t."{shared}" IN (SELECT k FROM chosen ORDER BY h LIMIT {take})',
                params=[[str(shard) for shard in part.shards]]).to_arrow_table()
            path = folder.path / f"sample-{part.table.short}.parquet"
            write_table(path, found, part.table, released=True)
            written.append(path)
    return written


def _shared(parts: tuple[Part, ...]) -> str:
    """The column that all tables of the folder have and that is a key of one; else the first's first key."""
    for name in ("page_id", "post_id", "video_id"):
        if all(name in part.table.names(released=True) for part in parts):
            return name
    return parts[0].table.key[0]
