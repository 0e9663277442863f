"""annotations/<source>/: the files of scores beside the rows, and how they become one.

toxicity.parquet        all scores, sorted, without duplicates
part-000000.parquet     what a run that goes on, or was cut off, has scored since
"""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from kb.artifacts import manifest
from kb.schema.tables import table
from kb.store.artifact_registry import MANIFEST
from kb.store.layout import Layout, parquet_files
from kb.store.tables import database, parquet
from kb.store.tables.reading import reading, scan
from kb.store.tables.shard_writer import ShardWriter, order

TABLE = "shared/annotations"
PARTS = "part-*.parquet"
KEY = ("text_hash", "model", "revision", "precision")
_BATCH = 50_000  # rows


def unite(folder: Path, others: Sequence[Path] = ()) -> Path:
    """Make one sorted file of those in the folder and other files of scores; its bytes depend on
    the scores alone. Raises DamagedData, DiskFull.
    """
    path, parts = folder / "toxicity.parquet", parquet_files(folder, PARTS)
    files = [*parquet_files(folder), *others]
    parquet.verify_files(*files)
    columns = table(TABLE).names()
    scores = ", ".join(name for name in columns if name not in KEY)
    (folder / MANIFEST).unlink(missing_ok=True)  # it describes the previous file
    # DuckDB sorts on disk when memory is short; rows come and go a batch at a time.
    with (
        reading(files),
        database.over(files, folder) as con,
        ShardWriter(path, TABLE, in_order=True) as writer,
    ):
        rows = con.sql(
            f"SELECT {', '.join(columns)} FROM {scan(files)} QUALIFY row_number() OVER"
            f" (PARTITION BY {', '.join(KEY)} ORDER BY {scores}) = 1"
            f" ORDER BY {', '.join(order(table(TABLE)))}"
        )
        for batch in rows.to_arrow_reader(_BATCH):
            writer.add_rows(pa.Table.from_batches([batch]))
    for part in parts:
        part.unlink()
    manifest.record(folder, f"annotations/{folder.name}")
    return path


def bring(root: Path, source: str, other: Path) -> int:
    """Add the scores of another data root that are not in this one; how many. Call it under the
    source's lock. Raises DamagedData, DiskFull.
    """
    manifest.check_complete(other, f"annotations/{source}")
    folder = Layout(root).annotations(source)
    theirs, ours = parquet_files(Layout(other).annotations(source)), parquet_files(folder)
    if not theirs:
        return 0
    folder.mkdir(parents=True, exist_ok=True)
    known, added = (
        f"SELECT DISTINCT {', '.join(KEY)} FROM {scan(files)}" for files in (ours, theirs)
    )
    sql = f"SELECT count(*) FROM ({added}{f' EXCEPT {known}' if ours else ''})"
    with reading([*theirs, *ours]), database.over([*theirs, *ours], folder) as con:
        parquet.verify_files(*theirs, *ours)
        new = int((con.execute(sql).fetchone() or (0,))[0])
    if new:
        unite(folder, theirs)
    return new
