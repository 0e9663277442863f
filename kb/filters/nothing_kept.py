"""A filter that keeps nothing says why, instead of ending as if all were well."""

from collections import Counter
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from kb.core.context import Run
from kb.core.errors import NothingKept
from kb.core.summary import Summary
from kb.store.layout import Layout, parquet_files
from kb.store.tables import parquet

_WHY = {"rejected": ("stage", "reason"), "failed": ("reason",)}  # the columns that say it


def check_kept(run: Run, source: str, summary: Summary) -> None:
    """Raises NothingKept (with `summary`) when every row failed or was rejected.

    Rows that wait for the crawl may still be kept.
    """
    if summary["kept"] or summary["pending"] or not summary["crawled"]:
        return
    verdict, why, n = _most_frequent(Layout(run.root).clean(source))
    error = NothingKept(
        f"nothing was kept of {summary['crawled']:,} {summary['counted']}; the most frequent"
        f" reason is {why} ({n:,} {verdict})",
        hint=f"see `kb query 'SELECT * FROM clean.{source}_{verdict}'` and the rules of"
        f" [{source}] in {run.profile.path}"
        if verdict == "rejected"
        else f"run `kb {source} crawl`, which retries what failed",
    )
    error.summary = summary
    raise error


def _most_frequent(folder: Any) -> tuple[str, str, int]:
    """(verdict, stage and reason, how many) of the largest group of rows."""
    counts: Counter[tuple[str, str]] = Counter()
    for verdict, columns in _WHY.items():
        for path in parquet_files(folder / verdict):
            rows = parquet.read_table(path, columns=list(columns))
            texts = [rows[name].cast(pa.string()) for name in columns]
            why = pc.binary_join_element_wise(*texts, ": ")
            for entry in pc.value_counts(why).to_pylist():
                counts[verdict, str(entry["values"])] += entry["counts"]
    (((verdict, why), n),) = counts.most_common(1)
    return verdict, why, n
