"""Rows of a source in a data root, for `kb status`: by table and verdict, and their age."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow.parquet as pq

from kb.artifacts.table_catalog import Catalog, view_name
from kb.core import clock
from kb.core.sources import SPECS
from kb.core.summary import vocabulary
from kb.schema.tables import tables as declared
from kb.store.layout import Layout, parquet_files
from kb.store.tables.reading import filtered, reading
from kb.store.tables.row_counts import rows, span, tally

if TYPE_CHECKING:
    from kb.core.context import Run

_ANSWERS = ("crawled", "kept", "rejected", "failed", "pending", "missing")


def answers(root: Path, source: str) -> dict[str, Any]:
    """The four verdicts of the last filter, in total and by table; empty before the first."""
    by_table = tally(Layout(root).clean(source), SPECS[source].tables)
    if not by_table:
        return {"tally": {}}
    total = {name: sum(each[name] for each in by_table.values()) for name in _ANSWERS}
    return {**total, "tally": by_table}


def tables(root: Path, source: str) -> dict[str, int]:
    """Rows by table of clean/<source>, verdicts included, from the files' footers."""
    folders = _tables_of(root, source)
    return _in_order({folder.name: rows(folder) for folder in folders})


def rows_of(catalog: Catalog, schema: str, source: str) -> dict[str, int]:
    """Rows by table of a source in one schema of the catalog, such as release or restored."""
    named = {f"{schema}.{view_name(one)}": one for one in declared().values()}
    counts: dict[str, int] = {}
    for view in catalog.views:
        one = named.get(view.full)
        if one is not None and one.source == source and one.short != "missing":
            with reading(view.files):
                counts[one.short] = sum(pq.read_metadata(file).num_rows for file in view.files)
    return _in_order(counts)


def age(run: Run, source: str, catalog: Catalog) -> dict[str, Any]:
    """Age of the kept, restored or released rows, and how many are too old for the profile."""
    max_age = getattr(getattr(run.profile, source), "max_age_days", None)
    limit = clock.now() - timedelta(days=max_age or 0)
    schema = catalog.schema_of(source)
    shown = {f"{schema}.{source}_{short}" for short in SPECS[source].tables}
    files = [file for view in catalog.views if view.full in shown for file in view.files]
    with reading(files):
        oldest, newest, old = span(files, "fetched_at", limit)
    return {
        "oldest": f"{oldest:%Y-%m-%dT%H:%M:%SZ}" if oldest else None,
        "newest": f"{newest:%Y-%m-%dT%H:%M:%SZ}" if newest else None,
        "max_age_days": max_age,
        "too_old": old if max_age else 0,
    }


def unknown_keys(root: Path, source: str) -> dict[str, int]:
    """Keys of answers that schemas/ does not declare, with how often they were seen by the last
    filter.
    """
    keys = filtered(root, source).get("unknown_keys", {})
    return keys if isinstance(keys, dict) else {}


def _tables_of(root: Path, source: str) -> list[Path]:
    """The folders of clean tables, those of verdicts too."""
    return [path for path in sorted(Layout(root).clean(source).glob("*/")) if parquet_files(path)]


def _in_order(counts: Mapping[str, int]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda item: vocabulary.place(item[0])))
