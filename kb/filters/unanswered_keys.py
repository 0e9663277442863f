"""Keys that a crawl requested and never received count as failed: every key has an outcome."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from kb.filters.chain import VERDICTS, Clean
from kb.filters.tasks import FilterJob, purged_keys
from kb.schema.tables import table
from kb.store.layout import parquet_files
from kb.store.tables import parquet
from kb.store.tables.shard_writer import write_table


def unanswered(job: FilterJob, spec: Clean) -> Counter[str]:
    """Keys that the crawl gave up on and that have no row: failed.

    One that waits for what was given up no longer waits.
    """
    assert spec.unanswered is not None
    lost = dict(spec.unanswered(Path(job.root)))
    waited = _ended(Path(job.out, "pending"), spec.ended_by_failure, lost)
    places = [(chain.table, chain.key, chain.prefix) for chain in spec.chains] + [
        (f"shared/{verdict}", "key", "") for verdict in VERDICTS
    ]
    for name, column, prefix in places if lost else ():
        for path in parquet_files(Path(job.out, table(name).short)):
            for key in parquet.read_table(path, columns=[column])[column].to_pylist():
                lost.pop(f"{prefix}{key}", None)
    for key in purged_keys(job.root, job.source, job.tombstones) if lost else ():
        lost.pop(key, None)
    if lost:
        rows = pa.table({"key": list(lost), "reason": list(lost.values())})
        write_table(Path(job.out, "failed", "part-crawl.parquet"), rows, "shared/failed")
    return Counter(crawled=len(lost) - waited, failed=len(lost), pending=-waited)


def _ended(pending: Path, reasons: tuple[str, ...], lost: Mapping[str, str]) -> int:
    """Take the rows of the keys in `lost` that wait for one of these reasons out of the pending
    ones; how many there were.
    """
    count = 0
    keys, of = pa.array(lost, pa.string()), pa.array(reasons, pa.string())
    for path in parquet_files(pending) if lost and reasons else ():
        rows = parquet.read_table(path)
        out = pc.and_(
            pc.is_in(rows["key"].cast(pa.string()), keys),
            pc.is_in(rows["reason"].cast(pa.string()), of),
        )
        left = rows.filter(pc.invert(out))
        if left.num_rows < rows.num_rows:
            count += rows.num_rows - left.num_rows
            path.unlink()
            if left.num_rows:
                write_table(path, left, "shared/pending", sync=False)
    return count
